"""`hrs/Station-v0`: a station as a Gymnasium environment, a second a step."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from api.bridges.gymnasium.dynamics import Dynamics, action_space, is_whole, observation_space
from api.bridges.gymnasium.episodes import Episode, check_options, drawn, named, scenario_of
from station import InputError, Record, Scenario
from station.vector_kernels import RUNNING, SERVED

Shown = NDArray[np.float32]


class StationEnv(gymnasium.Env[Shown, np.int64]):
    """A station whose valves are set each second until every vehicle is served.

    An observation is the vector of `station.vector_kernels.OBSERVED`, an action the place of a command among
    `env.unwrapped.commands`. `info` has `action_mask` (which commands the limits admit, int8), `costs` (the cost
    components of the step by name) and `time` [s]. An episode ends (`terminated`) when all vehicles are served and the
    compressors rest, or (`truncated`) at the scenario's time limit. Its record is that of `station.simulate`.

    Parameters
    ----------
    scenario
        What is played where `reset` is asked for nothing else: a name, a file, a mapping, or a Scenario.
    shield
        Whether the shield of the slot holds limits, with `logic` as fallback and the station's liveness rule. Without
        it only what physics forbids stays closed, and `costs["refused"]` counts the valves that violate a limit.
    weights
        Of cost components in the reward; left out: `api.bridges.gymnasium.dynamics.WEIGHTS`.
    render_mode
        None: there is nothing to see.

    Raises
    ------
    InputError
        naming what is wrong with the scenario or the weights.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}  # type: ignore[misc]

    def __init__(
        self, scenario: str | Mapping[str, Any] | Scenario = "S1", *, shield: bool = True,
        weights: Mapping[str, float] | None = None, render_mode: str | None = None,
    ) -> None:  # fmt: skip
        if render_mode is not None:
            raise InputError("environment", [("render_mode", f"must be None; given {render_mode!r}")])
        self.render_mode = None
        self.scenario = scenario_of(scenario)
        self.shield, self._weights = shield, weights
        self.observation_space, self.action_space = observation_space(), action_space(self.scenario)
        self._dynamics = self._made(self.scenario)
        self.commands = self._dynamics.run.commands
        self._over = True
        self._active = np.ones(1, np.bool_)

    def _made(self, scenario: Scenario) -> Dynamics:
        return Dynamics(scenario, 1, shield=self.shield, weights=self._weights, keeping=True)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Shown, dict[str, Any]]:
        """Begin a day: one that the seed draws, or that of options `replication` and `seed`; of another `scenario`.

        Raises
        ------
        InputError
            for an unknown option, or a scenario whose station has other commands.
        """
        super().reset(seed=seed)
        given = options or {}
        check_options(given)
        scenario = scenario_of(given.get("scenario", self.scenario))
        check_same_actions(scenario, len(self.commands))
        if scenario is not self._dynamics.run.scenario:
            self._dynamics = self._made(scenario)
        episode = (named(given, 1) or [drawn(self.np_random)])[0]
        self._dynamics.run.start(0, *episode)
        self._dynamics.run.begin()
        self._over = False
        return self._dynamics.run.shown[0].copy(), {**self._info(), **about(scenario, episode)}

    def step(self, action: np.int64) -> tuple[Shown, float, bool, bool, dict[str, Any]]:
        """Set the valves for a second.

        Raises
        ------
        ResetNeeded
            if the episode is over.
        InputError
            if the action is none of the station's.
        """
        if self._over:
            raise ResetNeeded("the episode is over: call reset() first")
        if not is_whole(action) or not 0 <= int(action) < len(self.commands):
            raise InputError(
                "step", [("action", f"must be a whole number from 0 to {len(self.commands) - 1}; given {action!r}")]
            )
        reward = self._dynamics.step(np.array([action], np.int64), self._active)
        over = int(self._dynamics.run.over[0])
        self._over = over != RUNNING
        shown = self._dynamics.run.shown[0].copy()
        return shown, float(reward[0]), over == SERVED, self._over and over != SERVED, self._info()

    def action_masks(self) -> NDArray[np.bool_]:
        """Which actions the limits admit now, (commands,), by the name under which MaskablePPO of sb3-contrib asks."""
        return self._dynamics.run.masks[0].astype(np.bool_)

    def _info(self) -> dict[str, Any]:
        run, dynamics = self._dynamics.run, self._dynamics
        costs = run.costs[0].tolist()
        return {
            "action_mask": run.masks[0].copy(),
            "costs": {name: costs[place] for name, place in zip(dynamics.names, dynamics.places, strict=True)},
            "time": float(run.times()[0]),
        }

    def record(self, name: str = "gymnasium") -> Record:
        """The record of the episode as far as it has come, by a controller called `name`."""
        return self._dynamics.run.record(name)


def about(scenario: Scenario, episode: Episode) -> dict[str, Any]:
    """Arguments with which `station.simulate` plays the same day, as `info` of a reset has them."""
    return {"scenario": scenario.name, "replication": episode.replication, "seed": episode.seed}


def check_same_actions(scenario: Scenario, number: int) -> None:
    """Raise InputError for a scenario whose station has another number of commands: spaces do not change."""
    found = int(action_space(scenario).n)
    if found != number:
        message = f"must be of a station with {number} commands, as the environment's is; given one with {found}"
        raise InputError("reset", [("scenario", message)])
