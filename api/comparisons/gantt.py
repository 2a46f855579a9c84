"""A drawing of schedules as inline SVG: every controller on one time axis, of bounded size however long the run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from markupsafe import Markup, escape

from api.comparisons.schedule import VALVES, Schedule, Span

WIDTH, LABEL, RIGHT, TOP, HEAD, ROW, THICK = 1100, 112, 14, 26, 24, 13, 8
"""Of the drawing, its column of names, its edges, a controller's line of text, a row and its bars [px]."""

FINE = 1.5
"""Bars that stand closer are drawn as one, shaded by the share of time they take [px]."""

APART = 1.6
"""Between vehicles that follow each other at once [px]."""

BIN = 4.0
"""Width of a shade [px]: a row has no more than WIDTH / BIN of them."""

SHADES = (0.3, 0.5, 0.72, 1.0)
_STEPS = (0.375, 0.625, 0.9)
"""Opacity by the share of time that a valve is open; one that is open every other second lies within a step."""

COLORS = {"high": "#c2410c", "medium": "#7c3aed", "low": "#0369a1", "wait": "#be185d", "fill": "#15803d"}

_TICKS = (1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200, 86400)

Piece = tuple[float, float, int]
"""From where to where [px], and which of SHADES."""


def gantt(scenario: str, found: Sequence[Schedule]) -> Markup:
    """Waiting, dispenser and valves of each controller, one above the other."""
    end = max(1.0, *(schedule.end for schedule in found))
    scale = (WIDTH - LABEL - RIGHT) / end
    height = TOP + len(found) * (HEAD + (2 + len(VALVES)) * ROW) + 4
    said = "; ".join(
        f"{each.controller}: {each.finished} of {len(each.waits)} vehicles finished, end {clock(each.end)}"
        for each in found
    )
    parts = [*_axis(end, scale, height)]
    for place, schedule in enumerate(found):
        parts += _group(schedule, TOP + place * (HEAD + (2 + len(VALVES)) * ROW), scale)
    name = escape(f"Schedule of {scenario}. {said}")
    return Markup(  # noqa: S704  # numbers of ours; names are escaped
        f'<svg class="gantt" viewBox="0 0 {WIDTH} {height}" role="img" aria-label="{name}">{"".join(parts)}</svg>'
    )


def clock(seconds: float) -> str:
    """Time since the station's start, as the dashboard writes it: 0:07:35, or 2 d 3:04:05."""
    days, rest = divmod(round(seconds), 86400)
    time = f"{rest // 3600}:{rest // 60 % 60:02}:{rest % 60:02}"
    return f"{days} d {time}" if days else time


def _axis(end: float, scale: float, height: int) -> Iterator[str]:
    step = next((each for each in _TICKS if end / each <= 9), 86400 * int(1 + end / (9 * 86400)))
    yield f'<text x="{LABEL - 40}" y="14" text-anchor="end">[h:min:s]</text>'
    for number in range(int(end // step) + 1):
        x = LABEL + number * step * scale
        anchor = "end" if x > WIDTH - 50 else "middle"
        yield f'<path class="grid" d="M{x:.1f} {TOP - 6}V{height}"/>'
        yield f'<text x="{x:.1f}" y="14" text-anchor="{anchor}">{clock(number * step)}</text>'


def _group(schedule: Schedule, top: int, scale: float) -> Iterator[str]:
    yield f'<path class="rule" d="M0 {top}.5H{WIDTH}"/>'
    yield f'<text class="name" x="0" y="{top + 16}">{escape(schedule.controller)}</text>'
    rows = [("waiting", "wait", schedule.waits), ("dispenser", "fill", schedule.fills)]
    rows += [
        (name.replace("_", " "), name.split("_")[1], spans) for name, spans in zip(VALVES, schedule.valves, strict=True)
    ]
    for row, (label, color, spans) in enumerate(rows):
        middle = top + HEAD + row * ROW + ROW / 2
        yield f'<text x="{LABEL - 8}" y="{middle + 4:g}" text-anchor="end">{label}</text>'
        yield f'<path class="grid" d="M{LABEL} {middle + ROW / 2:g}H{WIDTH - RIGHT}"/>'
        places = [(a * scale, b * scale) for a, b in spans]
        if label == "waiting":
            yield _waits(places, middle)
            continue
        if label == "dispenser":
            places = [(a, b - APART if b - a > 3 * APART else b) for a, b in places]
        yield from _bars(pieces(places), middle, COLORS[color])
        if label == "dispenser":
            yield from _numbers(spans, scale, middle)


def _waits(places: Sequence[Span], middle: float) -> str:
    """A triangle an arrival, those on the same pixel one; a band where anybody waits."""
    bands: list[list[float]] = []
    for left, right in places:
        if bands and left - bands[-1][1] < FINE:
            bands[-1][1] = max(right, bands[-1][1])
        else:
            bands.append([left, right])
    arrivals = sorted({round(LABEL + left) for left, _ in places})
    band = "".join(f"M{LABEL + a:.1f} {middle - 2:g}H{LABEL + b:.1f}v6H{LABEL + a:.1f}Z" for a, b in bands if b > a)
    marks = "".join(f"M{x} {middle + 5:g}l-3 -8h6Z" for x in arrivals)
    color = COLORS["wait"]
    return f'<path fill="{color}" opacity=".3" d="{band}"/><path fill="{color}" d="{marks}"/>'


def _numbers(fills: Sequence[Span], scale: float, middle: float) -> Iterator[str]:
    """Each vehicle's number on its bar, where there is room."""
    for number, (begin, end) in enumerate(fills):
        if (end - begin) * scale > 6 + 7 * len(str(number)):
            x = LABEL + (begin + end) / 2 * scale
            yield f'<text class="on" x="{x:.1f}" y="{middle + 3.5:g}" text-anchor="middle">{number}</text>'


def _bars(found: Sequence[Piece], middle: float, color: str) -> Iterator[str]:
    for shade, opacity in enumerate(SHADES):
        d = "".join(
            f"M{LABEL + left:.1f} {middle - THICK / 2:g}h{max(right - left, 0.5):.1f}v{THICK}H{LABEL + left:.1f}Z"
            for left, right, level in found
            if level == shade
        )
        if d:
            yield f'<path fill="{color}" opacity="{opacity:g}" d="{d}"/>'


def pieces(spans: Sequence[Span]) -> list[Piece]:
    """Spans as drawn [px]: as they are; where they come closer than FINE, the share of the place they take."""
    clusters: list[list[Span]] = []
    for span in spans:
        if clusters and span[0] - clusters[-1][-1][1] < FINE:
            clusters[-1].append(span)
        else:
            clusters.append([span])
    full = len(SHADES) - 1
    return [
        piece
        for cluster in clusters
        for piece in ([(*cluster[0], full)] if len(cluster) == 1 else _shaded(cluster))
    ]  # fmt: skip


def _shaded(cluster: Sequence[Span]) -> list[Piece]:
    """A cluster in bins of equal width; neighbours of one shade are one piece."""
    start, stop = cluster[0][0], max(right for _, right in cluster)
    count = max(1, round((stop - start) / BIN))
    wide = (stop - start) / count or 1.0
    taken = [0.0] * count
    for left, right in cluster:
        place = int((left - start) / wide)
        while place < count and start + place * wide < right:
            taken[place] += max(0.0, min(right, start + (place + 1) * wide) - max(left, start + place * wide))
            place += 1
    found: list[Piece] = []
    for place, sum_ in enumerate(taken):
        if sum_ < 0.02 * wide:
            continue
        shade = sum(sum_ >= step * wide for step in _STEPS)
        left, right = start + place * wide, start + (place + 1) * wide
        if found and found[-1][2] == shade and left - found[-1][1] < 0.01:
            found[-1] = (found[-1][0], right, shade)
        else:
            found.append((left, right, shade))
    return found
