"""The places of the k best of many scores, in order; no more is sorted than is asked for."""

from __future__ import annotations

import numpy as np

from station.compiled import inlined, uncounted

_FEW = 15
"""Places that are sorted by insertion."""


@inlined
def _middle(one: float, other: float, third: float) -> float:
    """The middle of three."""
    return max(min(one, other), min(max(one, other), third))


@inlined
def _split(values: np.ndarray, low: int, high: int, pivot: float, equal: bool) -> int:
    """Bring those of values[low:high] below `pivot`, or `equal` to it, to the front; gives where they end.

    It swaps whether or not it has to: a processor foresees no comparison.
    """
    end = low
    for place in range(low, high):
        value = values[place]
        values[place] = values[end]
        values[end] = value
        end += 1 if value < pivot or (equal and value == pivot) else 0
    return end


@inlined
def _bar(values: np.ndarray, size: int, most: int) -> float:
    """The greatest of the least `most` of values[:size], which are put in another order."""
    low, high = 0, size
    while True:
        pivot = _middle(values[low], values[(low + high) >> 1], values[high - 1])
        end = _split(values, low, high, pivot, False)
        if most <= end:
            high = end
            continue
        end = _split(values, end, high, pivot, True)
        if most <= end:
            return pivot
        low = end


@uncounted
def best_places(score: np.ndarray, most: int, room: np.ndarray, places: np.ndarray) -> int:
    """Write the places of the lowest `most` scores, and of what equals the last, into `places`; gives their number.

    They stay in the order in which they stand. `room` and `places` are as long as `score` at least.
    """
    bar = np.inf
    if score.size > most:
        for place in range(score.size):
            room[place] = score[place]
        bar = _bar(room, score.size, most)
    count = 0
    for place in range(score.size):
        places[count] = place
        count += 0 if score[place] > bar else 1  # a score that is no number leaves none without a place
    return count


@inlined
def _order(places: np.ndarray, one: int, other: int, score: np.ndarray) -> None:
    """Exchange two places unless the first has the lower score."""
    if score[places[other]] < score[places[one]]:
        places[one], places[other] = places[other], places[one]


@inlined
def _divide(places: np.ndarray, low: int, high: int, score: np.ndarray) -> int:
    """Divide places[low:high+1] by a pivot of theirs: lower scores before it, higher ones behind; gives where it is."""
    middle = (low + high) >> 1
    _order(places, low, middle, score)
    _order(places, middle, high, score)
    _order(places, low, middle, score)
    pivot = score[places[middle]]
    places[high], places[middle] = places[middle], places[high]
    left, right = low, high - 1
    while True:
        while left < high and score[places[left]] < pivot:
            left += 1
        while right >= low and pivot < score[places[right]]:
            right -= 1
        if left >= right:
            break
        places[left], places[right] = places[right], places[left]
        left, right = left + 1, right - 1
    places[left], places[high] = places[high], places[left]
    return left


@inlined
def _insert(places: np.ndarray, low: int, high: int, score: np.ndarray) -> None:
    """Sort places[low:high+1] by insertion."""
    for number in range(low + 1, high + 1):
        place, hole = places[number], number
        while hole > low and score[place] < score[places[hole - 1]]:
            places[hole] = places[hole - 1]
            hole -= 1
        places[hole] = place


@uncounted
def sort_on(places: np.ndarray, score: np.ndarray, low: int, pivots: np.ndarray, number: int) -> tuple[int, int]:
    """Sort on from `low`, before which all is sorted; gives how far that is then, and the new number of pivots.

    A quicksort that leaves what is behind its pivots for later. `pivots` (places.size + 1,) is room for those met and
    not passed, `number` of them; the first is the end: begin with `low` 0 and pivots[0] = places.size, 1 of them.
    """
    while pivots[number - 1] - low > _FEW:
        pivots[number] = _divide(places, low, pivots[number - 1] - 1, score)
        number += 1
    number -= 1
    _insert(places, low, pivots[number] - 1, score)
    return min(pivots[number] + 1, places.size), number
