"""The reserve rule, made to be certified, and the stages of its proof."""

from controllers.reserve.controller import Reserve

__all__ = ["Reserve"]
