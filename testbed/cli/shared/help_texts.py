# SPDX-License-Identifier: MIT
"""Help texts of the commands, in a module that imports nothing. The first line is the summary.

Examples work when they are pasted in their order; words in capitals stand for files of the user. Parameters are
described in the modules of the commands.
"""

HELP = {
    "run": """Simulate a robot in a world, map it, score the result.

A robot drives a tour of the world. The particle filter maps the world from its lidar and wheel odometry. Map and
trajectory are scored against the truth. The results are written to a directory: report.html, recording.rrd, maps,
trajectories, metrics.json.

```
testbed run office
testbed run loop --particles 50 --seed 3 --view
testbed run --config RUN/config.toml
```
""",
    "simulate": """Write synthetic datasets.

Each dataset is a directory with the recording, its truth, the world, and a config.toml that makes it again byte for
byte. Datasets that exist already are kept: a job that was cut off can be started again, and a larger `--count` adds to
them. Each seed drives to other stops in its world, unless `--route fixed` is given. `--plan` says what a job
will take. The default backend is `fast`; of `--driver`, `tour` and `recorded` can be used here.
Several datasets also get an index (datasets.parquet) with splits by world, a card (README.md) and a picture of the
drives.

```
testbed simulate office --out data
testbed slam data/office-0000
testbed simulate office,apartment,lab --out many --count 10 --draw lidar=lds01,rplidar_a2 --workers 2
testbed simulate 'generated:rooms*50' --out rooms --draw odometry.grade=good,poor --draw noise=0.5..2
testbed simulate office --out paired --vary lidar=lds01,rplidar_a2
testbed datasets info many
```
""",
    "datasets": """Say how much is in a directory of datasets; list them in a table.

```
testbed simulate office,lab --out data
testbed datasets info data
testbed datasets index data --test office
```
""",
    "slam": """Map a recorded log, or localise in a finished map; score it where truth is known.

The format is detected from the content: CARMEN logs (plain or gzip), ROS 1 and ROS 2 bags. The results are written to
a directory, as by `testbed run`.

```
testbed simulate office --out data
testbed slam data/office-0000
testbed slam LOG --truth TRUTH.tum --particles 50 --view
testbed slam LOG --relations RELATIONS
testbed slam LOG --map MAP.yaml --start 1.5,-2,90
```
""",
    "twin": """Make a simulated twin of a recorded log, to drive it again with other seeds.

The log is mapped; the walls of the final map become a world, the refined path becomes the drive. Lidar and odometry get
the settings that the log shows: noise, scale errors, slips. The twin is a directory with world.toml, robot.toml,
lidar.toml, commands.csv, off_wall.csv and the config.toml that `testbed run` and `testbed simulate` take.

```
testbed simulate office --out data
testbed twin data/office-0000 --out twin
testbed run --config twin/config.toml --seed 1
testbed simulate --config twin/config.toml --count 20 --out twins
testbed twin RUN --out another
```
""",
    "score": """Score the output of any SLAM system with the measures of `testbed run`.

The measures are printed as JSON, or written to `--out`.

```
testbed run office --out first
testbed score first --trajectory first/filter.tum
testbed score first --trajectory first/filter.tum --fail-if 'trajectory.ate_rmse_m > 0.05'
testbed score RUN --trajectory OTHER.tum --map OTHER.yaml
```
""",
    "report": """Rewrite the report of a run, or compare several runs.

```
testbed run loop --duration 20 --out a
testbed run loop --duration 20 --seed 1 --out b
testbed report a b --out comparison.html
testbed report RUN
```
""",
    "sweep": """Measure accuracy over worlds, seeds, variants and particle counts: how many particles are needed?

All particle counts and variants of a world and seed get the same data, so differences are paired. The results are
written to a directory: sweep.html, figures, tables. The same command continues a sweep that was interrupted.

```
testbed sweep --worlds office --particles 1,5,30 --seeds 3 --set duration=40 --out first-sweep
testbed sweep --worlds office,loop --particles 1,5,15,30 --seeds 40 --until decided --out sweep
testbed sweep --worlds office --particles 5,30 --axis odometry.grade=good,poor --out grades
testbed sweep --preset particles --out study
testbed sweep SPECIFICATION.toml --out parts --shard 0/8
```
""",
    "gather": """Write the tables and the report of a sweep from its finished runs.

Runs that are missing or have failed are listed; the exit status is then 1.

```
testbed sweep --worlds office --particles 1,5 --seeds 2 --set duration=20 --out parts
testbed gather parts
```
""",
    "view": """Open the recording of a run in the Rerun viewer.

```
testbed view --demo
testbed view --demo --time 60 --save moment.png
testbed view RUN
```
""",
    "inspect": """Say what is in a recorded log, and what of it is doubtful.

Topics, rates, gaps, mounts, beams, values for no return, odometry, clocks: a line each, with a verdict and what the
reader does about it. The same checks run in `testbed slam` and become notes of the run.

```
testbed simulate office --out data
testbed inspect data/office-0000
testbed inspect LOG --json
```
""",
    "convert": """Convert a recorded log to another format.

The conversion is lossless for all data that both formats support.

```
testbed simulate office --out data
testbed convert data/office-0000 office.log.gz --to carmen
testbed convert office.log.gz office-bag --to rosbag2
```
""",
    "stress": """Find how much of each perturbation SLAM systems survive.

Each perturbation is turned up until half of the runs fail: odometry noise, slip, lost scans, few beams, glass, people,
wrong clocks. All systems drive the same routes. The results are written to a directory: report.html, stress.parquet.
The same command continues a stress test that was interrupted. docs/stress.md explains the method.

```
testbed stress odometry,scan-matching --worlds office,loop --perturbations drop-scans,slip --seeds 5 --out stress
testbed stress scan-matching,gmapping --worlds office,loop,maze --plan
testbed stress FILE.py:CLASS,gmapping --log LOG,relations=RELATIONS
```
""",
    "perturb": """Make a recording harder: lost scans, noise, slipping wheels, glass, people, wrong clocks.

The output is a dataset directory that `testbed slam` and `testbed score` read; the truth is kept. The same seed gives
the same bytes. docs/stress.md describes the perturbations.

```
testbed simulate office --out data
testbed perturb data/office-0000 harder --drop-scans 0.3 --time-offset 0.05
testbed slam harder
testbed perturb data/office-0000 crowded --people 10 --seed 3
```
""",
    "worlds": """List, draw, generate and import worlds.

```
testbed worlds list
testbed worlds show office --out office.png
testbed worlds generate maze --seed 7 --out maze.toml
testbed run maze.toml
testbed worlds import MAP.yaml --out floor.toml
```
""",
    "presets": """List robots and lidars, and measure their odometry.

```
testbed presets list
testbed presets show create3
testbed presets umbmark
```
""",
    "systems": """List SLAM systems, and check your own.

A system is a Python class, in a file or a package. `run`, `slam` and `sweep` run it with `--system`, next to others on
the same data.

```
testbed systems list
testbed systems check odometry
testbed run office --system odometry,gmapping
testbed run office --system FILE.py:CLASS,gmapping
```
""",
    "warmup": """Compile the kernels now instead of in the first run.

This is useful in the build of a container image. The machine code is kept in `~/.cache/slam-testbed` or
`$TESTBED_CACHE`.

```
testbed warmup
```
""",
}
