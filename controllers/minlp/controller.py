"""The MINLP controllers: settings, weights of Table 7.2, and the choice of engine."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from controllers.base import CompiledBase
from controllers.estimate import use_station_prediction
from controllers.minlp.exact import decide_exact, memory_vector, settings_vector
from controllers.minlp.objective import Objective
from controllers.minlp.settings import NODES, MinlpSettings
from station.controller import CompiledController, Decision, Observation
from station.parameters import Station

if TYPE_CHECKING:
    from controllers.minlp.solvers import SolverEngine


ENGINES = {
    "pyomo": ("controllers.minlp.pyomo_engine", "PyomoEngine"),
    "casadi": ("controllers.minlp.casadi_engine", "CasadiEngine"),
}
"""Where the engines that ask a solver stand."""


def solver_engine(name: str) -> type[SolverEngine]:
    """The engine of that name; its solver is imported now, so that who never asks for one does not wait for it."""
    module, engine = ENGINES[name]
    found: type[SolverEngine] = getattr(import_module(module), engine)
    return found


class Minlp(CompiledBase):
    """Eq. (7.25) with weights c_eng, c_b, c_v."""

    settings_type = MinlpSettings
    settings_key = "minlp"
    energy_weight = 1.0  # c_eng
    buffer_weight = 1.0  # c_b
    vehicle_weight = 1.0  # c_v
    _engine: SolverEngine | None = None

    def objective(self, settings: MinlpSettings) -> Objective:
        """The stage cost with this controller's weights."""
        return Objective(
            compressor=self.energy_weight * settings.compressor_weight_bar2,
            precooler=self.energy_weight * settings.precooler_weight_bar2,
            buffers=self.buffer_weight,
            vehicle=self.vehicle_weight,
            target=settings.target_pressure_bar,
        )

    def compiled(self) -> CompiledController | None:
        """This controller for the compiled loop, with fresh memory; None with a solver's engine."""
        settings: MinlpSettings = self.settings_for(self.station)
        if settings.engine != "exact":
            return None
        plant = self.station.control_constants()
        vector = settings_vector(
            self.objective(settings), settings.horizon, settings.node_limit, settings.liveness, plant.compressor_count
        )
        memory = use_station_prediction(self.station, memory_vector(settings.horizon))
        return CompiledController(decide_exact, plant, vector, memory, self.obeys_hold)

    @property
    def bounded_time(self) -> bool:
        """Whether the search ends soon: ours, after no more nodes than by default."""
        settings: MinlpSettings = self.settings_for(self.station)
        return settings.engine == "exact" and settings.node_limit <= NODES

    def start(self, station: Station) -> None:
        """Prepare for a run on `station`, with the solver's engine where settings ask for one."""
        super().start(station)
        settings: MinlpSettings = self.settings_for(station)
        self._engine = None
        if settings.engine != "exact":
            self._engine = solver_engine(settings.engine)(
                station.control_constants(), self.objective(settings), settings
            )
            use_station_prediction(station, self._engine.memory)

    def decide(self, observation: Observation) -> Decision:
        """The command for this second."""
        return super().decide(observation) if self._engine is None else self._engine.decide(observation)


class Minlp1(Minlp):
    """MINLP 1: energy, buffers and vehicle weigh the same."""

    name = "minlp1"
    about = "MINLP with c_eng = c_b = c_v = 1 (Table 7.2): fills vehicle and buffers as fast as it can"


class Minlp2(Minlp):
    """MINLP 2: the vehicle alone."""

    name = "minlp2"
    about = "MINLP with c_v = 1 alone (Table 7.2): compresses only what the vehicle takes next"
    energy_weight = 0.0
    buffer_weight = 0.0


class Minlp3(Minlp):
    """MINLP 3: energy and vehicle."""

    name = "minlp3"
    about = "MINLP with c_eng = c_v = 1 (Table 7.2): compresses only where the gain is worth the energy"
    buffer_weight = 0.0
