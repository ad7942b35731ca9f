# SPDX-License-Identifier: MIT
"""Datasets: made by the simulator with their truth, collected with an index and a card, and loaded as arrays."""

from testbed.datasets.collection import Collection, open_collection
from testbed.datasets.loading import Dataset, open_dataset

__all__ = ["Collection", "Dataset", "open_collection", "open_dataset"]
