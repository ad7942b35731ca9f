# SPDX-License-Identifier: MIT
"""Help texts of the commands, in a module that imports nothing. The first line says what a person wants to do.

Examples work when they are pasted in their order; words in capitals stand for files of the user. Parameters are
described in the modules of the commands.
"""

HELP = {
    "run": """Simulate a robot in a world, map it, score the result.

```
testbed run office
testbed run loop --particles 50 --seed 3 --view
testbed run --config RUN/config.toml
```

A robot drives a tour; the particle filter maps the world from its lidar and wheel odometry; map and trajectory are
scored against the truth. Results are written to a directory: report.html, recording.rrd, maps, trajectories,
metrics.json.
""",
    "simulate": """Make recordings with known truth: simulated drives as ROS bags, CARMEN logs or tables.

```
testbed simulate office --out data
testbed slam data/office-0000
testbed simulate office,apartment,lab --out many --count 10 --draw lidar=lds01,rplidar_a2 --workers 2
testbed simulate 'generated:rooms*50' --out rooms --draw odometry.grade=good,poor --draw noise=0.5..2
testbed simulate office --out paired --vary lidar=lds01,rplidar_a2
testbed datasets info many
```

Each dataset is a directory with the recording, its truth, the world, and a config.toml that makes it again byte for
byte. Each seed drives to different stops. The same command continues a job that was cut off; a larger `--count` adds to
it. Several datasets also get an index, a card (README.md) and a picture of the drives.
""",
    "datasets": """See how much is in a directory of datasets; list them in a table.

```
testbed simulate office,lab --out data
testbed datasets info data
testbed datasets index data --test office
```
""",
    "slam": """Map a recorded log, or localise in a finished map; score it where truth is known.

```
testbed simulate office --out data
testbed slam data/office-0000
testbed slam LOG --truth TRUTH.tum --particles 50 --view
testbed slam LOG --relations RELATIONS
testbed slam LOG --map MAP.yaml --start 1.5,-2,90
```

The format is recognised from the content: CARMEN logs (plain or gzip), ROS 1 and ROS 2 bags, Parquet tables. Results
are written to a directory, as with `testbed run`.
""",
    "twin": """Make a simulated twin of a recorded log, to drive it again with other seeds.

```
testbed simulate office --out data
testbed twin data/office-0000 --out twin
testbed run --config twin/config.toml --seed 1
testbed simulate --config twin/config.toml --count 20 --out twins
testbed twin RUN --out another
```

The log is mapped; the walls of the final map become a world, the refined path becomes the drive. Lidar and odometry get
the settings that the log shows: noise, scale errors, slips. The twin is a directory with world.toml, robot.toml,
lidar.toml, commands.csv, off_wall.csv and the config.toml that `testbed run` and `testbed simulate` take.
""",
    "score": """Score the trajectory and map of any SLAM system with the same measures as `testbed run`.

```
testbed run office --out first
testbed score first --trajectory first/filter.tum
testbed score first --trajectory first/filter.tum --fail-if 'trajectory.ate_rmse_m > 0.05'
testbed score RUN --trajectory OTHER.tum --map OTHER.yaml
```

The measures are printed as JSON, or written to `--out`.
""",
    "report": """Compare runs, or write the report of a run again.

```
testbed run loop --duration 20 --out a
testbed run loop --duration 20 --seed 1 --out b
testbed report a b --out comparison.html
testbed report RUN
```
""",
    "sweep": """Find out how many particles are needed: accuracy over worlds, seeds, settings and particle counts.

```
testbed sweep --worlds office --particles 1,5,30 --seeds 3 --set duration=40 --out first-sweep
testbed sweep --worlds office,loop --particles 1,5,15,30 --seeds 40 --until decided --out sweep
testbed sweep --worlds office --particles 5,30 --axis odometry.grade=good,poor --out grades
testbed sweep --preset particles --out study
testbed sweep SPECIFICATION.toml --out parts --shard 0/8
```

All particle counts of a world and seed get the same data, so differences are paired. The results are written to a
directory: sweep.html, figures, tables. The same command continues a sweep that was interrupted.
""",
    "gather": """Write the tables and the report of a sweep from its finished runs.

```
testbed sweep --worlds office --particles 1,5 --seeds 2 --set duration=20 --out parts
testbed gather parts
```

Runs that are missing or have failed are listed; the exit status is then 1.
""",
    "view": """Watch a run, a dataset or a log in the Rerun viewer, or save a picture of one moment.

```
testbed view --demo
testbed view --demo --time 60 --save moment.png
testbed view RUN
```
""",
    "inspect": """See what a recorded log contains, and what in it looks wrong.

```
testbed simulate office --out data
testbed inspect data/office-0000
testbed inspect LOG --json
```

Topics, rates, gaps, mounts, beams, values for no return, odometry, clocks: a line each, with a verdict and what the
reader does about it. The same checks run in `testbed slam` and become notes of the run.
""",
    "convert": """Convert a recorded log to another format.

```
testbed simulate office --out data
testbed convert data/office-0000 office.log.gz --to carmen
testbed convert office.log.gz office-bag --to rosbag2
```

The conversion is lossless for all data that both formats support.
""",
    "stress": """Find out what a SLAM system survives: lost scans, slipping wheels, glass, people, wrong clocks.

```
testbed stress odometry,scan-matching --worlds office,loop --perturbations drop-scans,slip --seeds 5 --out stress
testbed stress scan-matching,gmapping --worlds office,loop,maze --plan
testbed stress FILE.py:CLASS,gmapping --log LOG,relations=RELATIONS
```

Each perturbation is turned up until half of the runs fail. All systems drive the same routes. The results are written
to a directory: report.html, stress.parquet. The same command continues a test that was interrupted.
""",
    "perturb": """Make a recording harder: lost scans, noise, slipping wheels, glass, people, wrong clocks.

```
testbed simulate office --out data
testbed perturb data/office-0000 harder --drop-scans 0.3 --time-offset 0.05
testbed slam harder
testbed perturb data/office-0000 crowded --people 10 --seed 3
```

The output is a dataset directory that `testbed slam` and `testbed score` read; the truth is kept. The same seed gives
the same bytes. docs/stress.md describes the perturbations.
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

```
testbed systems list
testbed systems check odometry
testbed run office --system odometry,gmapping
testbed run office --system FILE.py:CLASS,gmapping
```

A system is a Python class, in a file or a package. `run`, `slam` and `sweep` run it with `--system`, next to others on
the same data.
""",
    "warmup": """Compile the kernels now instead of in the first run.

```
testbed warmup
```

This is useful in the build of a container image. The machine code is kept in `~/.cache/slam-testbed` or
`$TESTBED_CACHE`.
""",
}
