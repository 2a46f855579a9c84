"""Sample constants of a plant: of the types that its kernels are compiled for."""

from __future__ import annotations

from typing import Any, TypeVar, get_args, get_origin, get_type_hints

C = TypeVar("C", bound=tuple[Any, ...])


_NUMBERS = (bool, int, float)


def _one(kind: Any) -> Any:
    if get_origin(kind) is tuple:
        return tuple(map(_one, get_args(kind)))
    if hasattr(kind, "_fields"):
        return sample_of(kind)
    if kind not in _NUMBERS:
        raise TypeError(f"a field of type {kind!r} must be given")
    return kind(1)


def sample_of(constants: type[C], **given: Any) -> C:
    """Constants in which every number is 1, but for those given by name: what a field is stands in its type alone.

    Parameters
    ----------
    constants
        A NamedTuple of numbers, tuples of them, and NamedTuples of the same; a field of another type must be given.
    **given
        Values of fields, in their units.

    Returns
    -------
    C
        An instance of `constants`.

    Raises
    ------
    TypeError
        for a field of another type that is not given.
    """
    fields = get_type_hints(constants).items()
    return constants(**{name: given[name] if name in given else _one(kind) for name, kind in fields})
