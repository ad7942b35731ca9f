# SPDX-License-Identifier: MIT
"""The SLAM programs of the Mobile Robot Programming Toolkit (MRPT), as Debian's package `mrpt-apps` installs them."""

from testbed.systems.mrpt.rawlog import write_rawlog

__all__ = ["write_rawlog"]
