# SPDX-License-Identifier: MIT
"""Localisation in a finished map."""

from slam.localization.localizer import Localization, LocalizationStatus

__all__ = ["Localization", "LocalizationStatus"]
