"""CSV traces that nobody meant, and those that once were a defect."""

from __future__ import annotations

import pytest

from tests.fuzz.rounds import rounds
from tests.fuzz.traces import PROPERTIES, check_trace_file, check_trace_text


@rounds(150, 3000)
@pytest.mark.parametrize("fuzzed", PROPERTIES, ids=lambda each: each.name)
def test_a_trace_is_read_or_refused(fuzzed, cases, seed):
    assert fuzzed.run(cases, seed) >= cases


@pytest.mark.parametrize("line", [b"x" * 200_000, b"60," + b"1" * 200_000])
def test_a_cell_too_long_for_the_reader_is_refused(line):
    for content in (line, b"time_s,start_pressure_bar\n" + line):
        check_trace_file(content)
        check_trace_text(content)
