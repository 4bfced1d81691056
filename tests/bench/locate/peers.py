"""One scan through the registration libraries of others: poses (row by row) and times as one JSON object.

ICP and GICP begin 10 mm and 3 degrees from the true place; the global methods have no start. Times hold everything from
points in memory to the pose, down-sampling and normals too.
"""
import json
import sys
import time

import numpy as np


def timed(work):
    begun = time.perf_counter()
    try:
        pose = np.asarray(work(), dtype=float).reshape(4, 4)
        return {"pose": pose.ravel().tolist(), "ms": 1e3 * (time.perf_counter() - begun)}
    except Exception as error:  # what a library cannot do is a result of the comparison
        return {"error": repr(error), "ms": 1e3 * (time.perf_counter() - begun)}


def main():
    with open(sys.argv[1], encoding="utf-8") as file:
        data = json.load(file)
    source = np.array(data["source"])
    target = np.array(data["target"])
    start = np.array(data["start"]).reshape(4, 4)
    found = {}
    try:
        import open3d as o3d

        reg = o3d.pipelines.registration

        def cloud(points, voxel=None, normals=False):
            made = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
            if voxel:
                made = made.voxel_down_sample(voxel)
            if normals:
                made.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(10.0, 30))
            return made

        def icp(method, normals):
            s, t = cloud(source), cloud(target, None, normals)
            criteria = reg.ICPConvergenceCriteria(max_iteration=100)
            return reg.registration_icp(s, t, 15.0, start, method, criteria).transformation

        def anywhere():
            s, t = cloud(source, 5.0, True), cloud(target, 5.0, True)
            near = o3d.geometry.KDTreeSearchParamHybrid(25.0, 100)
            fs, ft = reg.compute_fpfh_feature(s, near), reg.compute_fpfh_feature(t, near)
            checks = [
                reg.CorrespondenceCheckerBasedOnEdgeLength(0.9),
                reg.CorrespondenceCheckerBasedOnDistance(7.5),
            ]
            rough = reg.registration_ransac_based_on_feature_matching(
                s, t, fs, ft, True, 7.5, reg.TransformationEstimationPointToPoint(False), 3, checks,
                reg.RANSACConvergenceCriteria(100000, 0.999))
            plane = reg.TransformationEstimationPointToPlane()
            return reg.registration_icp(s, t, 5.0, rough.transformation, plane).transformation

        found["Open3D point to point"] = timed(lambda: icp(reg.TransformationEstimationPointToPoint(), False))
        found["Open3D point to plane"] = timed(lambda: icp(reg.TransformationEstimationPointToPlane(), True))
        found["Open3D FPFH + RANSAC"] = timed(anywhere)
    except ImportError as error:
        found["Open3D"] = {"error": repr(error)}
    try:
        import small_gicp

        found["small_gicp GICP"] = timed(lambda: small_gicp.align(
            target, source, init_T_target_source=start, downsampling_resolution=2.0,
            max_correspondence_distance=15.0, num_threads=2).T_target_source)
    except ImportError as error:
        found["small_gicp"] = {"error": repr(error)}
    try:
        import kiss_matcher

        def kiss():
            # Its noise bounds are clamped at 1, which is a metre for its maps and a millimetre here.
            params = kiss_matcher.KISSMatcherConfig(voxel_size=5.0, enable_noise_bound_clamping=False)
            result = kiss_matcher.KISSMatcher(params).estimate(source, target)
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = np.array(result.rotation), np.array(result.translation).ravel()
            return pose

        found["KISS-Matcher"] = timed(kiss)
    except ImportError as error:
        found["KISS-Matcher"] = {"error": repr(error)}
    print(json.dumps(found))


main()
