"""Claims about shortened drawings: the same lines with fewer characters."""

import re

from bess.report.drawing.style import shortened


def corners(path: str) -> list[tuple[float, float]]:
    """Corners of a path of M, L, H, V and z."""
    x = y = 0.0
    found = []
    for command, numbers in re.findall(r"([MLHVz])([^MLHVz]*)", path):
        values = [float(number) for number in numbers.split()]
        match command:
            case "H":
                x = values[0]
            case "V":
                y = values[0]
            case "z":
                continue
            case _:
                x, y = values
        found.append((x, y))
    return found


def test_a_step_line_keeps_its_corners() -> None:
    line = "M 51.88 65.71 \nL 53.10 65.71 \nL 53.10 -3.25 \nL 54.32 -3.25 \nL 60.01 7.5 \nz\n"
    (short,) = re.findall('d="([^"]*)"', shortened(f'<path d="{line}"/>'))
    assert short == "M51.8 65.7H53.1V-3.2H54.3L60.0 7.5z"
    assert corners(short) == [(51.8, 65.7), (53.1, 65.7), (53.1, -3.2), (54.3, -3.2), (60.0, 7.5)]


def test_curves_and_scales_are_left_as_they_are() -> None:
    text = '<g transform="scale(0.015625)"><path d="M 0 1.5 \nC 0.397 1.5 0.7 1.2 1 0 \nz\n"/></g>'
    assert shortened(text) == text
