"""The load of every contender: two arbitrage cycles a day, per unit of power, positive = discharge."""

# (hours, power per unit); parameters: docs/parameters.md, section on demand.
DAY = (
    (2.5, -1.0),
    (0.5, -0.4),
    (0.5, 0.0),
    (4.75, 1.0),
    (0.75, 0.4),
    (0.5, 0.0),
    (5.0, -1.0),
    (0.75, -0.4),
    (0.5, 0.0),
    (4.75, 1.0),
    (0.75, 0.4),
    (0.5, 0.0),
    (2.0, -1.0),
    (0.25, 0.0),
)


def series(step_s: float, days: float, peak: float) -> list[float]:
    """Powers for each step of ``step_s`` seconds over ``days`` days, scaled to ``peak``."""
    day = [peak * level for hours, level in DAY for _ in range(round(hours * 3600 / step_s))]
    whole, rest = divmod(days, 1)
    return day * int(whole) + day[: round(rest * len(day))]
