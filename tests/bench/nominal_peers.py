"""Distances of points from a mesh with Open3D: the last line is JSON with the distances, mm, and the time, ms."""

import json
import sys
import time

import numpy
import open3d

with open(sys.argv[1]) as file:
    given = json.load(file)
points = open3d.core.Tensor(numpy.array(given["points"], dtype=numpy.float32))
started = time.perf_counter()
scene = open3d.t.geometry.RaycastingScene()
scene.add_triangles(
    open3d.core.Tensor(numpy.array(given["vertices"], dtype=numpy.float32)),
    open3d.core.Tensor(numpy.array(given["triangles"], dtype=numpy.uint32)),
)
distances = scene.compute_distance(points).numpy()
elapsed_ms = (time.perf_counter() - started) * 1e3
print(json.dumps({"distances": distances.tolist(), "ms": elapsed_ms}))
