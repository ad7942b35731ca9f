# SPDX-License-Identifier: MIT
"""Twins of recordings: a world, a drive, a lidar and an odometry like those of a log, to be driven again.

`reconstruction` maps the log or reads a run; `walls`, `route`, `lidar` and `odometry` each make one part of the twin;
`twin` puts them together and writes them.
"""
