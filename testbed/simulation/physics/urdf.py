# SPDX-License-Identifier: MIT
"""URDF of a robot preset that drives accurately in PyBullet.

Measured with PyBullet 3.2.7: wheels that are cylinders rattle or veer, spheres do not. With the centre of mass over the
axle the body pitches when it brakes, and the encoders drift. With the centre of mass behind the axle, one caster
without friction and limited acceleration, wheel odometry follows the true path to a millimetre.
"""

from __future__ import annotations

from testbed.presets import RobotPreset

_CASTER_BEHIND_AXLE = 0.31
"""Distance of the caster behind the axle, as a share of the track (5 cm for a track of 16 cm)."""
_MASS_BEHIND_AXLE = 0.125
"""Distance of the centre of mass behind the axle, as a share of the track (2 cm for a track of 16 cm)."""
_WHEEL_MASS_SHARE = 0.04
"""Mass of one wheel as a share of the robot's (0.03 of 0.8 kg)."""

_BODY = '<material name="body"><color rgba="0.16 0.35 0.82 1"/></material>'
_TYRE = '<material name="tyre"><color rgba="0.2 0.2 0.2 1"/></material>'
"""Colours of the visuals: viewers draw a body without a colour in white, as floors."""

LEFT_WHEEL, RIGHT_WHEEL = "left_wheel_joint", "right_wheel_joint"


def robot_urdf(robot: RobotPreset) -> str:
    """Return the URDF text; base_link lies on the floor below the centre of the axle, x forward, z up."""
    r, wheel_mass = robot.wheel_radius, _WHEEL_MASS_SHARE * robot.mass
    wheels = "\n".join(
        _wheel(side, y, r, wheel_mass) for side, y in (("left", robot.track / 2.0), ("right", -robot.track / 2.0))
    )
    return f"""<?xml version="1.0"?>
<robot name="{robot.name}">
{_base(robot, robot.mass - 2.0 * wheel_mass)}
{wheels}
{_caster(-_CASTER_BEHIND_AXLE * robot.track, r / 2.0)}
</robot>
"""


def _base(robot: RobotPreset, mass: float) -> str:
    length, width, height, r = robot.length, robot.width, robot.height, robot.wheel_radius
    inertia = [mass / 12.0 * (a * a + b * b) for a, b in ((width, height), (length, height), (length, width))]
    shape = (
        f'<cylinder radius="{width / 2.0}" length="{height}"/>'
        if robot.round
        else f'<box size="{length} {width} {height}"/>'
    )
    body = f'<origin xyz="0 0 {r + height / 2.0}"/><geometry>{shape}</geometry>'
    return f"""  <link name="base_link">
    <inertial>
      <origin xyz="{-_MASS_BEHIND_AXLE * robot.track} 0 {r + height / 4.0}"/>
      <mass value="{mass}"/>
      <inertia ixx="{inertia[0]}" iyy="{inertia[1]}" izz="{inertia[2]}" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <collision>{body}</collision>
    <visual>{body}{_BODY}</visual>
  </link>"""


def _wheel(side: str, y: float, radius: float, mass: float) -> str:
    inertia = 0.4 * mass * radius**2  # solid sphere
    return f"""  <link name="{side}_wheel">
    <contact><lateral_friction value="1"/></contact>
    <inertial>
      <mass value="{mass}"/>
      <inertia ixx="{inertia}" iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <collision><geometry><sphere radius="{radius}"/></geometry></collision>
    <visual><geometry><cylinder radius="{radius}" length="{radius / 2.0}"/></geometry>{_TYRE}</visual>
  </link>
  <joint name="{side}_wheel_joint" type="continuous">
    <parent link="base_link"/>
    <child link="{side}_wheel"/>
    <origin xyz="0 {y} {radius}" rpy="-1.5707963267948966 0 0"/>
    <axis xyz="0 0 1"/>
  </joint>"""


def _caster(x: float, radius: float) -> str:
    return f"""  <link name="caster">
    <contact><lateral_friction value="0"/></contact>
    <inertial>
      <mass value="0.01"/>
      <inertia ixx="1e-6" iyy="1e-6" izz="1e-6" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <collision><geometry><sphere radius="{radius}"/></geometry></collision>
    <visual><geometry><sphere radius="{radius}"/></geometry>{_TYRE}</visual>
  </link>
  <joint name="caster_joint" type="fixed">
    <parent link="base_link"/>
    <child link="caster"/>
    <origin xyz="{x} 0 {radius}"/>
  </joint>"""
