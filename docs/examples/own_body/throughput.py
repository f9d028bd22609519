"""What a body costs: CPU time per user step of 50 ms, random actions, without an app.

cd docs/examples/own_body && python throughput.py mobl_arms_wrist mobl_arms_wrist+torso body.yaml
"""

from __future__ import annotations

import sys
import time

import numpy as np

from sim2vr_harness.users import UserBatch, load_body

USERS, STEPS = 8, 100

for wanted in sys.argv[1:] or ["mobl_arms_wrist"]:
    name, _, torso = wanted.partition("+")
    body = load_body(name, appearance=False, torso=torso == "torso")
    batch = UserBatch(body, USERS, threads=1, effort="zero", substeps=round(0.05 / body.timestep))
    rng = np.random.default_rng(1)
    begin = time.process_time()
    for _ in range(STEPS):
        batch.step(rng.uniform(-1, 1, (USERS, body.action_size)))
    each = (time.process_time() - begin) / (USERS * STEPS)
    print(f"{wanted}: {1e3 * each:.2f} ms per user step, {1 / each:.0f} steps/s on one core")
