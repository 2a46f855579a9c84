"""Sample constants of a plant: of the types that its kernels are compiled for."""

from __future__ import annotations

from typing import Any, TypeVar, get_args, get_origin, get_type_hints

C = TypeVar("C", bound=tuple[Any, ...])


def _one(kind: Any) -> Any:
    return tuple(map(_one, get_args(kind))) if get_origin(kind) is tuple else kind(1)


def sample_of(constants: type[C], **given: Any) -> C:
    """Constants in which every number is 1, but for those given by name: what a field is stands in its type alone.

    Parameters
    ----------
    constants
        A NamedTuple of numbers and tuples of numbers; a field of another type must be given.
    **given
        Values of fields, in their units.

    Returns
    -------
    C
        An instance of `constants`.
    """
    fields = get_type_hints(constants).items()
    return constants(**{name: given[name] if name in given else _one(kind) for name, kind in fields})
