"""A trained policy as a controller: it is shown in the slot what it was shown in the environment."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from controllers.base import BaseController
from station import Decision, Observation, Station
from station.entry_points import EntryPoint
from station.valves import commands
from station.vector_kernels import OBSERVED, admitted_by_model, write_observation


class PolicyController(BaseController):
    """Base of a plug-in that decides by a policy: a subclass has `name`, `about` and `act`.

    Gymnasium is not needed to run it. As every controller without limits of its own it has the shield, and `logic` as
    fallback, in `station.simulate` and in a live twin alike.
    """

    def act(self, shown: NDArray[np.float32], mask: NDArray[np.int8]) -> int:
        """The action for this second.

        Parameters
        ----------
        shown
            An observation as the environment gives it, (len(OBSERVED),).
        mask
            Which commands the limits of the station's control model admit, (commands,): at a station of the thesis's
            plant whose vehicles communicate what `info["action_mask"]` has, elsewhere what a controller can know of
            it.
        """
        raise NotImplementedError(f"{type(self).__name__} must define act()")

    def start(self, station: Station) -> None:
        """Prepare for a run on `station`."""
        super().start(station)
        self._commands = np.array(commands(station.compressor.count), np.int64)
        self._model: Any = station.control_constants()
        self._shown = np.zeros(len(OBSERVED), np.float32)
        self._write, self._admitted = EntryPoint(write_observation), EntryPoint(admitted_by_model)

    def decide(self, observation: Observation) -> Decision:
        """The command of the policy's action.

        Raises
        ------
        ValueError
            if the action is none of the station's.
        """
        self._write(observation, self._shown)
        admitted = self._admitted(observation, self._model)
        mask = (self._commands & ~admitted == 0).astype(np.int8)
        action = self.act(self._shown.copy(), mask)
        if not isinstance(action, int | np.integer) or not 0 <= action < len(self._commands):
            raise ValueError(f"act() must give a whole number from 0 to {len(self._commands) - 1}; given {action!r}")
        return Decision(int(self._commands[action]))
