"""Lines over flat and curved parts in mr-sim: the depth across the lane's middle, µm, and the seconds it takes, as JSON."""

import json
import math
import sys
import time

import matplotlib

matplotlib.use("Agg")
import mr_sim
import numpy

asked = json.loads(sys.argv[1])
METRE = 1e-3
omega = asked["rev_min"] * 2 * math.pi / 60
dt = asked["step_mm"] / asked["feed_mm_s"]
told = []
for kx, ky in asked["cases"]:
    flat = kx == 0 and ky == 0
    pressure = mr_sim.Flat if flat else mr_sim.ConstantCurvature
    Simulation = mr_sim.create_simulation(mr_sim.Round, pressure, mr_sim.Orbital, mr_sim.Preston)
    more = {} if flat else {"kx": kx / METRE, "ky": ky / METRE, "stiffness": asked["stiffness"] * 1e9}
    simulation = Simulation(
        asked["sides_mm"][0] * METRE,
        asked["sides_mm"][1] * METRE,
        kp=asked["kp"] * 1e-6,
        radius=asked["radius_mm"] * METRE,
        eccentricity=asked["orbit_mm"] / 2 * METRE,
        dt=dt,
        **more,
    )
    simulation.set_speed(omega)
    simulation.set_force(asked["force_n"])
    steps = round(80 / asked["step_mm"])
    started = time.perf_counter()
    for step in range(steps):
        simulation.set_location((-40 + (step + 0.5) * asked["step_mm"]) * METRE, 0)
        simulation.step()
    seconds = time.perf_counter() - started
    middle = numpy.argmin(numpy.abs(simulation.X[0]))
    told.append({"across_um": (simulation.profile[:, middle] * 1e6).tolist(), "seconds": seconds})
print(json.dumps(told))
