"""The thesis's pipeline (4.3, Fig. 4.9) with Python's OpenCV, timed on the same frames: whole, and cropped to the region.

Called by the bench with a folder of JPEG frames (the first is the reference) and the region's box; prints medians, ms.
"""
import glob
import statistics
import sys
import time

import cv2
import numpy

ALPHA, BETA, MEDIAN_PX, PASSES, THRESHOLD = 4.0, 0.0, 3, 2, 52
LOW, HIGH = numpy.array([0, 0, 0]), numpy.array([179, 255, 255])


def pipeline(reference, test):
    difference = cv2.absdiff(reference, test)
    adjusted = cv2.convertScaleAbs(difference, alpha=ALPHA, beta=BETA)
    for _ in range(PASSES):
        adjusted = cv2.medianBlur(adjusted, MEDIAN_PX)
    largest = cv2.max(cv2.max(adjusted[:, :, 0], adjusted[:, :, 1]), adjusted[:, :, 2])
    _, binary = cv2.threshold(largest, THRESHOLD - 1, 255, cv2.THRESH_BINARY)
    masked = cv2.bitwise_and(test, test, mask=binary)
    hsv = cv2.inRange(cv2.cvtColor(masked, cv2.COLOR_BGR2HSV), LOW, HIGH)
    contours, _ = cv2.findContours(cv2.bitwise_and(hsv, binary), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return contours


def main():
    folder, (left, top, width, height) = sys.argv[1], map(int, sys.argv[2:6])
    cv2.setNumThreads(2)
    decode, whole, cropped = [], [], []
    reference = None
    box = numpy.s_[top : top + height, left : left + width]
    for file in sorted(glob.glob(folder + "/*.jpg")):
        begun = time.perf_counter()
        test = cv2.imread(file)
        decode.append(time.perf_counter() - begun)
        if reference is None:
            reference = test
            continue
        begun = time.perf_counter()
        pipeline(reference, test)
        whole.append(time.perf_counter() - begun)
        part, reference_part = numpy.ascontiguousarray(test[box]), numpy.ascontiguousarray(reference[box])
        begun = time.perf_counter()
        pipeline(reference_part, part)
        cropped.append(time.perf_counter() - begun)
    found = [statistics.median(times) * 1e3 for times in (decode, whole, cropped)]
    print(
        "  thesis's pipeline, Python OpenCV %s, %d frames: decoding %.2f ms; whole frame %.2f ms; cropped %.2f ms"
        % (cv2.__version__, len(whole), *found)
    )


main()
