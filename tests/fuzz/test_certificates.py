"""Certificates that somebody changed, and those that once were a defect."""

from __future__ import annotations

import copy
import math

import pytest

from controllers.certified.service import RefusedError
from controllers.certified.service import verify as verify_service
from tests.fuzz.certificates import PROPERTIES, certificates, service_properties
from tests.fuzz.rounds import rounds
from theory import Refused, verify
from theory.checker import checksum


@pytest.mark.slow
@rounds(150, 3000)
@pytest.mark.parametrize("fuzzed", PROPERTIES, ids=lambda each: each.name)
def test_a_changed_certificate_is_refused(fuzzed, cases, seed):
    assert fuzzed.run(cases, seed) >= cases


@pytest.mark.full
def test_a_changed_certificate_of_service_is_refused(proved):
    (fuzzed,) = service_properties(proved)
    assert fuzzed.run(100, 1) >= 100


def test_nodes_that_no_edge_reaches_do_not_fill_the_memory():
    """Two million nodes with a matrix each; the document has some kilobytes."""
    against = next(each for each in certificates() if each["claim"]["kind"] == "infeasible")
    made = copy.deepcopy(against)
    made["proof"]["nodes"] = 1_999_999
    made["checksum"] = checksum(made)
    with pytest.raises(Refused, match="1999999 nodes"):
        verify(made)


@pytest.mark.parametrize(
    "changes",
    [
        {"cell_bar": 10**400}, {"cell_bar": math.inf, "cell_k": math.nan},
        {"states": {"high": {"floor": [[math.inf, 1.0]], "top_bar": 1.0}}},
        {"states": {name: {"floor": [[24.0, 1.0]], "top_bar": 1e12} for name in ("high", "medium", "low")}},
        {"states": {name: {"floor": [[24.0, math.nan]], "top_bar": 900.0} for name in ("high", "medium", "low")}},
    ],
)  # fmt: skip
def test_a_proof_with_figures_of_no_station_is_refused_unproved(proved, changes):
    with pytest.raises(RefusedError, match="is not what a certificate holds"):
        verify_service({**proved, "proof": {**proved["proof"], **changes}})


def test_options_that_are_none_are_refused(proved):
    with pytest.raises(RefusedError):
        verify_service({**proved, "controller": {"name": "reserve", "options": [1]}})
