# SPDX-License-Identifier: MIT
"""What an agent observes, and how a person sees it."""
