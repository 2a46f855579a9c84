"""The reserve controller: the rule in the slot, with nothing where the shield closes one of its valves."""

from __future__ import annotations

import numpy as np

from controllers.base import CompiledBase
from controllers.estimate import use_station_prediction
from controllers.reserve.rule import MEMORY_SIZE, reserve_command
from controllers.reserve.settings import ReserveSettings, reserve_vector
from station.compiled import callback
from station.controller import DECIDE, CompiledController, Decision, Observation
from station.kernels import CLOSED_CONTROLLER
from station.planning import Model


@callback(DECIDE, counted=False)
def decide_reserve(observation: Observation, model: Model, settings: np.ndarray, memory: np.ndarray) -> Decision:
    """The command of the rule."""
    return Decision(reserve_command(observation, model, settings, memory), 0, np.nan, np.nan)


class Waiting(CompiledBase):
    """Opens nothing: asked where the shield closes a valve of the reserve rule."""

    name = "waiting"

    def compiled(self) -> CompiledController:
        """The controller that keeps every valve closed."""
        return CLOSED_CONTROLLER


class Reserve(CompiledBase):
    """Begins each fill with low and medium while the compressor raises high, which ends it.

    A vehicle never goes back to a buffer, no decision compares two buffers, and turns at the compressor go by the
    clock: that is what lets its service be proved for boxes of states (`controllers.certified`). Like logic it is
    exempt from Eq. (7.16). At real gas, where nothing is proved, a vehicle that waits for high goes back to whichever
    buffer is above it, and above its own least pressure, far enough.
    """

    name = "reserve"
    about = "a rule with a certificate of service: fills begin with low and medium, high is kept for their end"
    obeys_hold = False
    settings_type = ReserveSettings
    settings_key = "reserve"

    def compiled(self) -> CompiledController:
        """This controller for the compiled loop, fresh."""
        vector = reserve_vector(self.settings_for(self.station), self.station)
        memory = use_station_prediction(self.station, np.zeros(MEMORY_SIZE))
        return CompiledController(decide_reserve, self.station.control_constants(), vector, memory, self.obeys_hold)

    @property
    def fallback(self) -> CompiledBase:
        """None: where the shield closes a valve, that side waits."""
        return Waiting()
