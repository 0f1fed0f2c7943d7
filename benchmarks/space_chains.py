"""Serial chains in space, of a robot that nobody has built: their joints turn about random axes."""

from __future__ import annotations

from pathlib import Path

import numpy as np


def chain_file(folder: Path, joints: int, seed: int) -> Path:
    """A serial chain in space: links of 0.2 m, joints about random axes, masses that become less along it."""
    rng = np.random.default_rng(seed)
    text = ['<robot name="chain">']
    for k in range(joints + 1):
        mass = 4.0 * 0.85**k
        ixx, iyy, izz = mass * np.array([0.004, 0.005, 0.003])
        text.append(
            f'<link name="l{k}"><inertial><origin xyz="0.1 0 0.01"/><mass value="{mass}"/><inertia ixx="{ixx}" '
            f'iyy="{iyy}" izz="{izz}" ixy="0.0001" ixz="0" iyz="0"/></inertial></link>'
        )
    for k in range(joints):
        axis = " ".join(map(str, np.round(rng.normal(size=3), 3)))
        rpy = " ".join(map(str, np.round(rng.uniform(-1, 1, 3), 3)))
        text.append(
            f'<joint name="j{k}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/><origin xyz="0.2 0 0" '
            f'rpy="{rpy}"/><axis xyz="{axis}"/><limit lower="-2" upper="2" effort="0" velocity="0"/></joint>'
        )
    path = folder / f"chain{joints}_{seed}.urdf"
    path.write_text("\n".join([*text, "</robot>"]))
    return path
