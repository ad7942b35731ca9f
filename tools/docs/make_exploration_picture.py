# SPDX-License-Identifier: MIT
"""Draw docs/pictures/explore.png: what the filter knows after 0, 20, 40 and 60 s of `testbed/Explore-v0`.

Run it from the repository's root: `python tools/docs/make_exploration_picture.py`.
"""

import gymnasium as gym
import numpy as np
from matplotlib.image import imsave

from testbed.exploration import make_explorer
from testbed.simulation import DriverConfig


def main() -> None:
    """One drive in the apartment by information gain per metre."""
    env = gym.make("testbed/Explore-v0", world="apartment", render_mode="rgb_array")
    env.reset(seed=2)
    inner, pictures = env.unwrapped, []
    config = DriverConfig(strategy="information")
    explorer = make_explorer(inner.robot_setup.robot, inner.robot_setup.lidar, config, np.random.default_rng(0))
    for step in range(601):
        if step % 200 == 0:
            pictures.append(env.render())
        env.step(inner.action(*explorer.command(inner.belief)))
    imsave("docs/pictures/explore.png", np.hstack(pictures))
    env.close()


if __name__ == "__main__":
    main()
