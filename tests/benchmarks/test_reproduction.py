"""docs/reproduction.md stays true: its first tables and its closeness are computed afresh."""

from __future__ import annotations

import pytest

from benchmarks import fits
from benchmarks.documents import DOCS, part, with_parts
from benchmarks.reproduction import closeness_part, tables_part


@pytest.fixture(scope="module")
def document() -> str:
    return (DOCS / "reproduction.md").read_text(encoding="utf-8")


def test_the_printed_tables_beside_ours_are_those_of_a_fresh_run(document: str) -> None:
    fresh = tables_part(fits.figures(fits.shipped("thesis-fit")))
    assert part(document, "tables").strip() == fresh


@pytest.mark.slow
def test_signs_orderings_and_errors_are_those_of_a_fresh_run(document: str) -> None:
    fresh = closeness_part(
        {name: (fits.figures(fits.shipped(name)), fits.figures(fits.own_shapes(name))) for name in fits.FITS}
    )
    assert part(document, "closeness").strip() == fresh


def test_every_fitted_number_is_perturbed_by_its_own_factor() -> None:
    class Half:
        """A generator whose draws are all -1/2."""

        def uniform(self, low: float, high: float, count: int) -> object:
            return fits.np.full(count, low / 2)

    moved = fits.perturbed(0.01, Half())  # type: ignore[arg-type]
    for old, new in zip(fits.shipped("thesis-fit"), moved, strict=True):
        assert new.station.buffers.low.volume_m3 == pytest.approx(0.995 * old.station.buffers.low.volume_m3)
        absolute = old.station.thermal.buffer_temperature_max_c + 273.15
        assert new.station.thermal.buffer_temperature_max_c + 273.15 == pytest.approx(0.995 * absolute)
        before, after = old.station.controllers["minlp"], new.station.controllers["minlp"]
        assert after["compressor_weight_bar2"] == 2 * after["precooler_weight_bar2"]
        assert after["target_pressure_bar"] == pytest.approx(0.995 * before["target_pressure_bar"])
    assert moved[1].arrivals.truncation == pytest.approx(0.995 * fits.shipped("thesis-fit")[1].arrivals.truncation)  # type: ignore[union-attr]


def test_a_document_without_the_part_is_refused() -> None:
    with pytest.raises(ValueError, match="no part called 'tables'"):
        with_parts("prose", {"tables": "x"})


def test_a_part_is_replaced_and_the_prose_kept() -> None:
    text = "before\n<!-- generated: a -->\nold\n<!-- end of a -->\nafter"
    assert with_parts(text, {"a": "new"}) == "before\n<!-- generated: a -->\n\nnew\n\n<!-- end of a -->\nafter"
