"""VR hardware worn by a body: a rigid child body and a site, both with the device's name.

Departure from the reference, which holds free bodies by soft welds that slip by 1.9 mm on average
and start every episode at the pose of the zero posture (SIM2VR paper's release).
"""

from collections.abc import Sequence

import mujoco

from sim2vr_harness.users.bodies.tables import DeviceRow


def attach_device(
    parent: mujoco.MjsBody,
    device: DeviceRow,
    position: Sequence[float],
    quaternion: Sequence[float],
    weight: bool = True,
) -> None:
    """Adds a device to the body that wears it.

    Args:
        parent: the body.
        device: mass, inertia and the pose that OpenXR reports, relative to the device.
        position: of the device's frame (x forward, y left, z up) in the parent's, m.
        quaternion: w x y z.
        weight: whether it has the device's mass; without, only its pose is known.
    """
    body = parent.add_body(name=device.name, pos=position, quat=quaternion)
    if weight:
        body.mass = device.mass
        body.ipos = device.com
        body.iquat = device.inertia_quat_wxyz
        body.inertia = device.inertia
        body.explicitinertial = True
    body.add_site(name=device.name, pos=device.openxr_offset, size=[0.004] * 3, group=4)
