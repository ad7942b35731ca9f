# SPDX-License-Identifier: MIT
"""Help texts of the commands, in a module that imports nothing. The first line is the summary.

Parameters are described in the modules of the commands.
"""

HELP = {
    "run": """Simulate a robot in a world, map it, score the result.

A robot drives a tour of the world; its lidar and wheel odometry feed the particle filter; map and trajectory are scored
against the truth. The results go into a directory: report.html, recording.rrd, maps, trajectories, metrics.json.

```
testbed run office
testbed run loop --particles 50 --seed 3 --view
testbed run --config runs/office-20250101-120000/config.toml
```
""",
    "simulate": """Write synthetic datasets.

Each is a directory with the recording, its truth, the world, and a config.toml that makes it again byte for byte. Those
that are there already are kept, so that a job that was cut off can be started again. The default backend is `fast`.

```
testbed simulate office --out datasets --count 100 --workers 2
testbed simulate office --out poor --odometry.grade poor --format carmen
testbed simulate office --out paired --vary lidar=lds01,rplidar_a2
testbed slam datasets/office-0000
```
""",
    "slam": """Map a recorded log, or localise in a finished map; score it where truth is known.

The format is recognised from the content: CARMEN logs (plain or gzip), ROS 1 and ROS 2 bags. The results go into a
directory, as those of `testbed run`.

```
testbed slam intel.clf.gz --relations intel.relations
testbed slam robot.log --truth mocap.tum --particles 50 --view
testbed slam robot.log --map office.yaml --start 1.5,-2,90
```
""",
    "score": """Score the output of any SLAM system by the same measures.

The measures are printed as JSON, or written to `--out`.

```
testbed score runs/office-20250101-120000 --trajectory other.tum --map other.yaml
testbed score runs/office-20250101-120000 --trajectory other.tum --fail-if 'trajectory.ate_rmse_m > 0.05'
```
""",
    "report": """Write the report of a run anew, or compare several runs.

```
testbed report runs/office-20250101-120000
testbed report runs/a runs/b runs/c --out comparison.html
```
""",
    "sweep": """How many particles? Accuracy over worlds, seeds, variants and particle counts, with intervals.

Every count and variant of a world and seed gets the same data, so differences are paired. The results go into a
directory: sweep.html, figures, tables. A sweep that was killed goes on where it was by the same command.

```
testbed sweep --worlds office,loop --particles 1,2,5,10,20,50,100 --seeds 10 --out sweep
testbed sweep --worlds office --particles 5,30 --axis odometry.grade=good,poor --out grades
testbed sweep --preset particles --out study
testbed sweep study.toml --out study --shard 0/8
```
""",
    "gather": """Tables and report of a sweep from its cells.

Names the cells that are missing or have failed, and exits with 1 if there are any.

```
testbed gather sweep
```
""",
    "view": """Open the recording of a run in the Rerun viewer.

```
testbed view runs/office-20250101-120000
```
""",
    "convert": """Turn a recorded log into another format.

What both formats can hold is kept to the last digit.

```
testbed convert robot.bag robot.log.gz --to carmen
testbed convert robot.log.gz robot --to rosbag2
```
""",
    "worlds": """The catalogue of worlds, generators, floor plans.

```
testbed worlds list
testbed worlds show office --out office.png
testbed worlds generate maze --seed 7 --out maze.toml
testbed worlds import floor.yaml --out floor.toml
```
""",
    "presets": """Robots and lidars, and how good their odometry is.

```
testbed presets list
testbed presets show create3
testbed presets umbmark
```
""",
    "warmup": """Compile the kernels now instead of in the first run.

Useful while a container image is built. The machine code is kept in `~/.cache/slam-testbed`, or `$TESTBED_CACHE`.

```
testbed warmup
```
""",
}
