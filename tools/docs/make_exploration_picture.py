# SPDX-License-Identifier: MIT
"""Draw the estimated map after 0, 20, 40 and 60 s of `testbed/Explore-v0` in the apartment.

    python -m tools.docs.make_exploration_picture

Writes: docs/pictures/explore.png
"""

import argparse
from pathlib import Path

import gymnasium as gym
import numpy as np
from matplotlib.image import imsave

from testbed.exploration import make_explorer
from testbed.simulation import DriverConfig

PICTURE = Path(__file__).resolve().parents[2] / "docs" / "pictures" / "explore.png"


def main() -> None:
    """Explore the apartment by information gain per metre and draw the map four times."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    env = gym.make("testbed/Explore-v0", world="apartment", render_mode="rgb_array")
    env.reset(seed=2)
    inner, pictures = env.unwrapped, []
    config = DriverConfig(strategy="information")
    explorer = make_explorer(inner.robot_setup.robot, inner.robot_setup.lidar, config, np.random.default_rng(0))
    for step in range(601):
        if step % 200 == 0:
            pictures.append(env.render())
        env.step(inner.action(*explorer.command(inner.belief)))
    imsave(PICTURE, np.hstack(pictures))
    env.close()


if __name__ == "__main__":
    main()
