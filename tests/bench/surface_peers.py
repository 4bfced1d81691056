"""A point of the same surface with its first and second derivatives, in geomdl and scipy: µs a point, as JSON."""

import json
import statistics
import sys
import time

import numpy
from geomdl import BSpline
from scipy.interpolate import NdBSpline

with open(sys.argv[1]) as file:
    net = json.load(file)


def knots(axis):
    spans, low, high = net[axis]
    return [low] * 3 + [low + (high - low) * n / spans for n in range(spans + 1)] + [high] * 3


def median_us(work, points, runs=5):
    times = []
    for _ in range(runs):
        started = time.perf_counter()
        work()
        times.append((time.perf_counter() - started) / points * 1e6)
    return statistics.median(times)


count_u, count_v = net["u"][0] + 3, net["v"][0] + 3

surface = BSpline.Surface(normalize_kv=False)
surface.degree_u = surface.degree_v = 3
surface.set_ctrlpts(net["controls"], count_u, count_v)
surface.knotvector_u, surface.knotvector_v = knots("u"), knots("v")
few = [((n * 0.618034) % 1.0, (n * 0.414214) % 1.0) for n in range(2_000)]

many = numpy.array([((n * 0.618034) % 1.0, (n * 0.414214) % 1.0) for n in range(100_000)])
controls = numpy.array(net["controls"]).reshape(count_u, count_v, 3)
spline = NdBSpline((numpy.array(knots("u")), numpy.array(knots("v"))), controls, 3)
orders = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)]

print(
    json.dumps(
        {
            "geomdl": median_us(lambda: [surface.derivatives(u, v, 2) for u, v in few], len(few)),
            "scipy NdBSpline": median_us(lambda: [spline(many, nu=order) for order in orders], len(many)),
        }
    )
)
