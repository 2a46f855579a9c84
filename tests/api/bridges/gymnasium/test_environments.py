"""`hrs/Station-v0` against Gymnasium's own checks, against `simulate`, and many environments against single ones."""

from __future__ import annotations

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from api.bridges.gymnasium.dynamics import WEIGHTS
from api.bridges.gymnasium.policy import PolicyController
from station import ControllerError, InputError, load_scenario, load_station, simulate
from station.vector_kernels import OBSERVED

SHORT = load_scenario("S1").model_dump() | {"time_limit_s": 2400.0}
REAL_GAS = load_scenario("S1").on(load_station("h70-light")).model_dump() | {"time_limit_s": 2400.0}


def allowed(mask, generator):
    """A random action among those that the mask admits."""
    return int(generator.choice(np.flatnonzero(mask)))


@pytest.mark.parametrize("shield", [True, False])
@pytest.mark.parametrize("scenario", [SHORT, REAL_GAS], ids=["thesis", "real_gas"])
def test_the_checker_of_gymnasium_finds_nothing(scenario, shield):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        environment = gymnasium.make("hrs/Station-v0", scenario=scenario, shield=shield)
        check_env(environment.unwrapped)


@pytest.mark.parametrize(("count", "actions"), [(1, 13), (2, 19), (3, 20)])
def test_a_station_has_an_action_for_each_of_its_commands(count, actions):
    document = load_scenario("S1").model_dump()
    document["station"]["compressor"]["count"] = count
    environment = gymnasium.make("hrs/Station-v0", scenario=document)
    assert environment.action_space == gymnasium.spaces.Discrete(actions)
    _, info = environment.reset(seed=1)
    assert info["action_mask"].shape == (actions,)
    assert environment.action_space.sample(mask=info["action_mask"]) in environment.action_space
    assert environment.unwrapped.action_masks().tolist() == info["action_mask"].astype(bool).tolist()


class Masked(PolicyController):
    """A policy that draws among the commands that are admitted."""

    name, about = "masked", "random, but admitted"

    def __init__(self, seed, **options):
        super().__init__(**options)
        self.seed = seed

    def start(self, station):
        super().start(station)
        self.generator, self.seen = np.random.default_rng(self.seed), []

    def act(self, shown, mask):
        self.seen.append((shown.tobytes(), mask.tobytes()))
        return allowed(mask, self.generator)


@pytest.mark.parametrize("replication", [0, 3])
def test_a_policy_is_shown_in_the_slot_what_it_was_shown_in_the_environment(replication):
    """Same seed, same observations, masks and bytes of the record."""
    scenario = load_scenario("S1")
    controller = Masked(5)
    expected = simulate(scenario, controller, replication=replication, seed=11)
    environment = gymnasium.make("hrs/Station-v0", scenario="S1")
    shown, info = environment.reset(options={"replication": replication, "seed": 11})
    assert (info["scenario"], info["replication"], info["seed"]) == ("S1", replication, 11)
    generator, seen, rewards, over = np.random.default_rng(5), [], [], False
    while not over:
        seen.append((shown.tobytes(), info["action_mask"].tobytes()))
        shown, reward, terminated, truncated, info = environment.step(allowed(info["action_mask"], generator))
        over = terminated or truncated
        rewards.append(reward)
    assert seen == controller.seen
    record = environment.unwrapped.record("masked")
    assert record.to_bytes() == expected.to_bytes()
    metrics = record.metrics()
    cost = sum(getattr(metrics, f"t_{name}") * WEIGHTS[at] for name, at in NAMED)
    assert -sum(rewards) == pytest.approx(cost, rel=1e-9)
    with pytest.raises(ResetNeeded):
        environment.unwrapped.step(0)


NAMED = (("total", "waiting"), ("comp", "compressor"), ("dis", "dispensing"))


@pytest.mark.parametrize("shield", [True, False])
def test_many_environments_are_what_each_is_alone(shield):
    """Our vector environment against Gymnasium's own around single ones: seeds, days, resets, rewards and info."""
    ours = gymnasium.make_vec("hrs/Station-v0", num_envs=3, scenario=SHORT, shield=shield)
    theirs = SyncVectorEnv(
        [lambda: gymnasium.make("hrs/Station-v0", scenario=SHORT, shield=shield) for _ in range(3)],
        autoreset_mode=AutoresetMode.NEXT_STEP,
    )
    assert ours.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert (ours.observation_space, ours.action_space) == (theirs.observation_space, theirs.action_space)
    found, expected = ours.reset(seed=21), theirs.reset(seed=21)
    generator, ends = np.random.default_rng(1), 0
    for _ in range(2600):
        assert found[0].tobytes() == expected[0].tobytes()
        assert found[-1]["action_mask"].tobytes() == expected[-1]["action_mask"].tobytes()
        for name, values in expected[-1]["costs"].items():
            assert values.tolist() == found[-1]["costs"][name].tolist(), name
        assert [list(part) for part in found[1:-1]] == [list(part) for part in expected[1:-1]]
        if "seed" in expected[-1]:
            assert found[-1]["seed"].tolist() == expected[-1]["seed"].tolist()
        actions = np.array([allowed(mask, generator) for mask in found[-1]["action_mask"]])
        found, expected = ours.step(actions), theirs.step(actions)
        ends += int((found[2] | found[3]).sum())
    assert ends >= 3  # each has begun a second day
    theirs.close()
    ours.close()


def test_days_can_be_named_for_each_run():
    ours = gymnasium.make_vec("hrs/Station-v0", num_envs=2)
    _, info = ours.reset(options={"replication": [1, 2], "seed": 5, "scenario": "S2"})
    assert info["scenario"].tolist() == ["S2", "S2"]
    assert (info["replication"].tolist(), info["seed"].tolist()) == ([1, 2], [5, 5])


def test_observations_stay_within_their_space():
    environment = gymnasium.make("hrs/Station-v0", scenario=SHORT, shield=False)
    environment.reset(seed=3)
    generator = np.random.default_rng(3)
    for _ in range(2000):
        shown, _, terminated, truncated, _ = environment.step(int(generator.integers(13)))
        assert shown in environment.observation_space
        if terminated or truncated:
            break
    assert shown.shape == (len(OBSERVED),)


def test_energy_is_told_and_weighed_where_somebody_knows_it():
    environment = gymnasium.make("hrs/Station-v0", weights={"energy": 2.0})
    environment.reset(seed=1)
    command = environment.unwrapped.commands.tolist().index(4)
    _, reward, *_, info = environment.step(command)
    power = load_scenario("S1").station.compressor.power_kw
    assert info["costs"]["energy"] == pytest.approx(power / 3600)
    assert reward == pytest.approx(-2 * power / 3600)
    document = load_scenario("S1").model_dump(exclude_none=True)
    del document["station"]["compressor"]["power_kw"]
    unknown = gymnasium.make("hrs/Station-v0", scenario=document)
    _, info = unknown.reset(seed=1)
    assert "energy" not in info["costs"]
    with pytest.raises(InputError, match="energy: cannot be weighed"):
        gymnasium.make("hrs/Station-v0", scenario=document, weights={"energy": 1.0})


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"replicaton": 1}, "replicaton: is no option; there are scenario, replication, seed"),
        ({"replication": -1}, "replication: must be a whole number from 0"),
        ({"seed": True}, "seed: must be a whole number from 0"),
        ({"replication": [1, 2, 3]}, "replication: must be one number, or one for each of"),
    ],
)
@pytest.mark.parametrize("make", [gymnasium.make, lambda name: gymnasium.make_vec(name, num_envs=2)])
def test_wrong_options_are_refused_by_name(make, options, message):
    with pytest.raises(InputError, match=message):
        make("hrs/Station-v0").reset(options=options)


def test_what_is_wrong_is_refused_by_name():
    with pytest.raises(InputError, match="S9"):
        gymnasium.make("hrs/Station-v0", scenario="S9")
    with pytest.raises(InputError, match="wating: is no cost component"):
        gymnasium.make("hrs/Station-v0", weights={"wating": 1.0})
    for weight in ("1", float("nan"), None, True):
        with pytest.raises(InputError, match=f"waiting: must be a finite number; given {weight!r}"):
            gymnasium.make("hrs/Station-v0", weights={"waiting": weight})
    with pytest.raises(InputError, match="shield: must be true or false; given 'no'"):
        gymnasium.make("hrs/Station-v0", shield="no")
    for number in (0, -1, 2.0):
        with pytest.raises(InputError, match=f"num_envs: must be a whole number of at least 1; given {number}"):
            gymnasium.make_vec("hrs/Station-v0", num_envs=number)
    environment = gymnasium.make("hrs/Station-v0").unwrapped
    environment.reset(seed=1)
    for action in (13, -1, 1.5, float("nan"), None, "1"):
        with pytest.raises(InputError, match=f"action: must be a whole number from 0 to 12; given {action!r}"):
            environment.step(action)
    assert environment.step(np.array(0))[4]["time"] == 1.0, "a whole number is one in whatever NumPy holds it"
    two = load_scenario("S1").model_dump()
    two["station"]["compressor"]["count"] = 2
    with pytest.raises(InputError, match="scenario: must be of a station with 13 commands"):
        environment.reset(options={"scenario": two})
    many = gymnasium.make_vec("hrs/Station-v0", num_envs=2)
    with pytest.raises(ResetNeeded):
        many.step(np.zeros(2, np.int64))
    many.reset(seed=[1, 2])
    with pytest.raises(InputError, match="seed: must be one, or one for each of 2; given 3"):
        many.reset(seed=[1, 2, 3])
    for actions in (np.array([0, 13]), np.array([0]), np.array([-1, 0]), np.array([1.5, 0.0]), [0, np.nan]):
        with pytest.raises(InputError, match="actions: must be 2 whole numbers from 0 to 12"):
            many.step(actions)
    disturbed = load_scenario("S1").model_dump() | {"disturbance": {"sensors": "uniform", "plant": "corner"}}
    with pytest.raises(InputError, match="disturbance: must be left out where more runs"):
        gymnasium.make_vec("hrs/Station-v0", num_envs=2, scenario=disturbed)


@pytest.mark.parametrize("action", [13, -1, 0.5, None])
def test_a_policy_whose_action_is_none_is_told_so(action):
    class Astray(PolicyController):
        name = "astray"
        about = "answers with what is no action"

        def act(self, shown, mask):
            return action

    with pytest.raises(ControllerError, match=f"act.. must give a whole number from 0 to 12; given {action}"):
        simulate(load_scenario(SHORT["name"]), Astray())
