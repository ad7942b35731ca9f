# SPDX-License-Identifier: MIT
"""Numbers as people read them."""

from __future__ import annotations

from eval.wording import length, share, spread


def test_numbers_for_people():
    assert [length(x) for x in (0.0123, 0.45, 1.234)] == ["1.2\xa0cm", "45\xa0cm", "1.23\xa0m"]
    assert [spread(0.0181, 0.012), spread(5.12, 8.15)] == ["1.81 ± 1.20\xa0cm", "5.12 ± 8.15\xa0m"]
    assert [share(x) for x in (0.0, 0.004, 0.37, 0.996, 0.99999)] == [
        f"{number}\xa0%" for number in ("0", "0.4", "37", "99.6", "100")
    ]
