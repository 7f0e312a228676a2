# SPDX-License-Identifier: Apache-2.0
"""The pinched ball by MuJoCo's flexible shells; run by an interpreter that has MuJoCo.

`python mujoco_ball.py EDGE < forces.json`: the whole sphere under the forces [N] per pole of a
JSON list, each brought to rest by dynamic relaxation (MuJoCo has no static solver): velocities are
set to zero whenever the kinetic energy falls. Prints {"depth_mm": […], "steps": …,
"cpu_seconds": …, "unknowns": …} as the last line.
"""

from __future__ import annotations

import json
import sys
import time

import mujoco
import numpy as np
from ball_mesh import POISSON, THICKNESS, YOUNG, pin_weights, sphere

TIME_STEP = 1e-3
MASS = 0.02
MOST_STEPS = 3000
# At rest when nothing moves faster than this share of a radius per second.
STILL = 1e-3


def model_text(points: np.ndarray, triangles: np.ndarray) -> str:
    """The ball in SI units as a two-dimensional flex with a free body at every vertex."""
    places = ' '.join(f'{x:.9g}' for x in (1e-3 * points).ravel())
    faces = ' '.join(str(i) for i in triangles.ravel())
    return f"""
<mujoco>
  <option gravity="0 0 0" timestep="{TIME_STEP}" integrator="discrete"/>
  <size memory="500M"/>
  <worldbody>
    <flexcomp name="ball" type="direct" dim="2" mass="{MASS}" radius="1e-4"
              point="{places}" element="{faces}">
      <contact selfcollide="none" contype="0" conaffinity="0"/>
      <elasticity young="{1e6 * YOUNG}" poisson="{POISSON}" thickness="{1e-3 * THICKNESS}"
                  elastic2d="both"/>
    </flexcomp>
  </worldbody>
</mujoco>"""


def main() -> None:
    """Solve all loads."""
    points, triangles = sphere(int(sys.argv[1]))
    forces = json.load(sys.stdin)
    shares = pin_weights(points, triangles) - pin_weights(
        points * [1.0, 1.0, -1.0], triangles[:, ::-1]
    )
    start = time.process_time()
    model = mujoco.MjModel.from_xml_string(model_text(points, triangles))
    data = mujoco.MjData(model)
    top, bottom = int(np.argmax(points[:, 2])), int(np.argmin(points[:, 2]))
    mujoco.mj_forward(model, data)
    rest = data.flexvert_xpos[[top, bottom], 2].copy()
    depths, steps = [], 0
    for force in forces:
        data.qfrc_applied[:] = 0.0
        data.qfrc_applied[2::3] = -force * shares
        kinetic = 0.0
        for _ in range(MOST_STEPS):
            mujoco.mj_step(model, data)
            steps += 1
            now = float(data.qvel @ data.qvel)
            if now < kinetic:
                if np.abs(data.qvel).max() < STILL * 31.25e-3:
                    break
                data.qvel[:] = 0.0
                now = 0.0
            kinetic = now
        moved = data.flexvert_xpos[[top, bottom], 2] - rest
        depths.append(500.0 * float(moved[1] - moved[0]))
    print(
        json.dumps(
            {
                'depth_mm': depths,
                'steps': steps,
                'cpu_seconds': time.process_time() - start,
                'unknowns': model.nv,
            }
        )
    )


if __name__ == '__main__':
    main()
