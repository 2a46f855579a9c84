"""A file that is wrong leaves nothing to run, however it is picked and however it is mended."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from tests.api.page.test_files import HEADER, pick, tracing  # noqa: F401  # a fixture

WRONG, MENDED = f"{HEADER}60,120\n70,many\n", f"{HEADER}60,120\n70,125\n"


def _set(page, path):
    page.locator("#scenario-trace").set_input_files(path)


def _drop(page, path):
    """As a file that is dropped on the control: no click, and the browser may tell the same name."""
    transfer = page.evaluate_handle(
        """([name, text]) => {
            const transfer = new DataTransfer();
            transfer.items.add(new File([text], name, { type: "text/csv" }));
            return transfer;
        }""",
        [path.name, path.read_text()],
    )
    page.locator("#scenario-trace").evaluate(
        """(control, transfer) => {
            control.files = transfer.files;
            control.dispatchEvent(new Event("change", { bubbles: true }));
        }""",
        transfer,
    )


def _can_be_run(page, count):
    expect(page.locator("#scenario-trace-wrong")).to_be_empty()
    expect(page.locator("figcaption")).to_contain_text(f"{count} vehicles")
    expect(page.locator(".tag.good")).to_have_text("can be run")
    for button in page.locator("[data-needs-valid]").all():
        expect(button).to_be_enabled()


def _cannot_be_run(page):
    expect(page.locator("#scenario-trace-wrong")).to_contain_text("line 3, start_pressure_bar: must be a number")
    expect(page.locator(".tag.bad")).to_be_visible()
    expect(page.get_by_text("can be run")).to_have_count(0)
    expect(page.locator("figcaption")).to_have_count(0)
    page.wait_for_timeout(600)  # what the service says of every change has come
    expect(page.locator(".tag.bad")).to_be_visible()
    expect(page.locator("#scenario-trace-wrong")).to_contain_text("line 3")
    buttons = page.locator("[data-needs-valid]").all()
    assert len(buttons) == 3
    for button in buttons:
        expect(button).to_be_disabled()


@pytest.mark.slow
def test_after_a_wrong_file_the_earlier_day_cannot_be_run(tracing, tmp_path):  # noqa: F811
    path = tmp_path / "day.csv"
    for pass_on in (_set, _drop, pick):
        path.write_text(MENDED)
        pass_on(tracing, path)
        _can_be_run(tracing, 2)
        path.write_text(WRONG)
        pass_on(tracing, path)
        _cannot_be_run(tracing)


def test_another_change_does_not_make_up_for_a_wrong_file(tracing, tmp_path):  # noqa: F811
    path = tmp_path / "day.csv"
    path.write_text(MENDED)
    _set(tracing, path)
    _can_be_run(tracing, 2)
    path.write_text(WRONG)
    _set(tracing, path)
    _cannot_be_run(tracing)
    tracing.get_by_label("Replication", exact=True).fill("1")
    tracing.get_by_label("Replication", exact=True).fill("0")
    _cannot_be_run(tracing)
    tracing.locator('input[name=kind][value="uniform"]').check()
    expect(tracing.locator(".tag.good")).to_have_text("can be run")


@pytest.mark.slow
def test_a_mended_file_of_the_same_path_is_read_without_a_click(tracing, tmp_path):  # noqa: F811
    path = tmp_path / "day.csv"
    for pass_on in (_set, _drop):
        path.write_text(WRONG)
        pass_on(tracing, path)
        _cannot_be_run(tracing)
        path.write_text(MENDED)
        pass_on(tracing, path)
        _can_be_run(tracing, 2)
        path.write_text(f"{MENDED}80,130\n")
        pass_on(tracing, path)
        _can_be_run(tracing, 3)
