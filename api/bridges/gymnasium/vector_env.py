"""Many stations as one Gymnasium vector environment, all stepped by one call of compiled code."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from api.bridges.gymnasium.dynamics import Dynamics, action_space, is_whole, observation_space
from api.bridges.gymnasium.episodes import Episode, check_options, drawn, named, scenario_of
from api.bridges.gymnasium.station_env import about, check_same_actions
from station import InputError, Scenario
from station.vector_kernels import RUNNING, SERVED, TIME_OVER

Batch = NDArray[Any]


class StationVectorEnv(VectorEnv[Batch, Batch, Batch]):
    """`num_envs` stations of one scenario; run i is `StationEnv` with the seed of the batch plus i, bit for bit.

    A run that has ended is begun anew by the next step, whose action it ignores (AutoresetMode.NEXT_STEP). Arguments
    are those of StationEnv. Scenarios with a disturbance or faults of the plant have another plant in each run: they
    are played one by one, or in `vectorization_mode="sync"` or `"async"`.

    Raises
    ------
    InputError
        naming what is wrong with the scenario or the weights.
    """

    metadata: ClassVar[dict[str, Any]] = {  # type: ignore[misc]
        "render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP
    }  # fmt: skip

    def __init__(
        self, num_envs: int = 1, scenario: str | Mapping[str, Any] | Scenario = "S1", *, shield: bool = True,
        weights: Mapping[str, float] | None = None, render_mode: str | None = None,
    ) -> None:  # fmt: skip
        if render_mode is not None:
            raise InputError("environment", [("render_mode", f"must be None; given {render_mode!r}")])
        if isinstance(num_envs, bool) or not isinstance(num_envs, int | np.integer) or num_envs < 1:
            raise InputError("environment", [("num_envs", f"must be a whole number of at least 1; given {num_envs!r}")])
        self.num_envs = int(num_envs)
        self.scenario = scenario_of(scenario)
        self.shield, self._weights = shield, weights
        self.single_observation_space, self.single_action_space = observation_space(), action_space(self.scenario)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._dynamics = self._made(self.scenario)
        self.commands = self._dynamics.run.commands
        self._finished: NDArray[np.bool_] | None = None
        self._all = np.ones(num_envs, np.bool_)
        self._generators: list[np.random.Generator] = []

    def _made(self, scenario: Scenario) -> Dynamics:
        return Dynamics(scenario, self.num_envs, shield=self.shield, weights=self._weights, keeping=False)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Batch, dict[str, Any]]:
        """Begin a day in every run; options are those of StationEnv, `replication` and `seed` one or one for each run.

        Raises
        ------
        InputError
            for an unknown option, a wrong number of seeds, or a scenario whose station has other commands.
        """
        given = options or {}
        check_options(given)
        self._seed_runs(seed)
        scenario = scenario_of(given.get("scenario", self.scenario))
        check_same_actions(scenario, len(self.commands))
        if scenario is not self._dynamics.run.scenario:
            self._dynamics = self._made(scenario)
        episodes = named(given, self.num_envs) or [drawn(generator) for generator in self._generators]
        for place, episode in enumerate(episodes):
            self._dynamics.run.start(place, *episode)
        self._dynamics.run.begin()
        self._finished = np.zeros(self.num_envs, np.bool_)
        info = self._info()
        self._tell(info, range(self.num_envs), episodes)
        return self._dynamics.run.shown.copy(), info

    def _seed_runs(self, seed: int | Sequence[int | None] | None) -> None:
        """Give each run a generator of its own; without a seed those that there are go on."""
        if seed is None and self._generators:
            return
        seeds: list[int | None]
        if seed is None or isinstance(seed, int | np.integer):
            seeds = [None if seed is None else int(seed) + place for place in range(self.num_envs)]
        else:
            seeds = list(seed)
        if len(seeds) != self.num_envs:
            raise InputError(
                "reset", [("seed", f"must be one, or one for each of {self.num_envs}; given {len(seeds)}")]
            )
        self._generators = [seeding.np_random(each)[0] for each in seeds]
        if seeds[0] is not None:
            super().reset(seed=seeds[0])

    def step(self, actions: Batch) -> tuple[Batch, Batch, Batch, Batch, dict[str, Any]]:
        """Set the valves of every station for a second; a run that had ended is begun anew instead, for no reward.

        Raises
        ------
        ResetNeeded
            before the first reset.
        InputError
            if an action is none of the station's.
        """
        if self._finished is None:
            raise ResetNeeded("call reset() first")
        run, finished = self._dynamics.run, self._finished
        chosen = np.ascontiguousarray(actions, np.int64) if is_whole(actions) else np.empty(0, np.int64)
        if chosen.shape != (self.num_envs,) or chosen.min() < 0 or chosen.max() >= len(self.commands):
            message = f"must be {self.num_envs} whole numbers from 0 to {len(self.commands) - 1}; given {actions!r}"
            raise InputError("step", [("actions", message)])
        begun = np.flatnonzero(finished).tolist()
        episodes = [drawn(self._generators[place]) for place in begun]
        for place, episode in zip(begun, episodes, strict=True):
            run.start(place, *episode)
        rewards = self._dynamics.step(chosen, ~finished)
        rewards[finished] = 0.0
        self._finished = run.over != RUNNING
        info = self._info()
        self._tell(info, begun, episodes)
        return run.shown.copy(), rewards, run.over == SERVED, run.over == TIME_OVER, info

    def _info(self) -> dict[str, Any]:
        """Masks and costs of all runs, each beside the flags that say which runs have it."""
        run, every = self._dynamics.run, self._all
        costs = run.costs.T.copy()
        found: dict[str, Any] = {}
        for name, place in zip(self._dynamics.names, self._dynamics.places, strict=True):
            found[name], found[f"_{name}"] = costs[place], every
        return {
            "action_mask": run.masks.copy(), "_action_mask": every, "costs": found, "_costs": every,
            "time": run.times(), "_time": every,
        }  # fmt: skip

    def _tell(self, info: dict[str, Any], begun: Sequence[int], episodes: Sequence[Episode]) -> None:
        """Add to `info` which days have begun."""
        for place, episode in zip(begun, episodes, strict=True):
            self._add_info(info, about(self._dynamics.run.scenario, episode), place)
