"""The commands `follow` and `calibrate` as a user types them."""

from __future__ import annotations

import json

import pytest

from station.geometry import VALVES
from station.sensor_names import ANALOG
from tests.api.test_cli import hrs
from tests.station.estimation.hidden import csv_text, day, hidden_station, measured, truth

TAGS = "".join(
    f'[[tags]]\ntag = "{name}"\ncolumn = "{name}"\nsensor = "{name}"\n'
    f'source = "{"plc" if name in (*VALVES, "vehicle") else "transmitters"}"\n'
    for name in (*ANALOG, *VALVES, "vehicle")
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("measured")
    record = day(hidden_station(1))
    (folder / "record.csv").write_text(csv_text(measured(truth(record, 86_400), 1, skew=3)))
    (folder / "tags.toml").write_text(TAGS)
    return folder


@pytest.mark.slow
def test_a_station_is_calibrated_and_followed(folder):
    given = ("record.csv", "--tags", "tags.toml", "--station")
    refused = hrs("follow", *given, "thesis-fit", "--json", "refused.json", cwd=folder)
    assert refused.returncode == 3
    assert "model refused: " in refused.stderr
    document = json.loads((folder / "refused.json").read_text())
    assert document["verdict"] == "refused"
    assert [event["name"] for event in document["events"]] == ["clock_skew_transmitters"]
    done = hrs("calibrate", *given, "thesis-fit", "--out", "mine.toml", "--json", "c.json", cwd=folder)
    assert done.returncode == 0, done.stderr
    document = json.loads((folder / "c.json").read_text())
    assert list(document) == ["verdict", "channels", "parameters", "events"]
    assert document["verdict"] == "accepted"
    assert set(document["channels"]) == set(ANALOG)
    assert not document["parameters"]["buffers.low.volume_m3"]["known"]
    followed = hrs("follow", *given, "mine.toml", "--json", "f.json", "--plot", "f.png", cwd=folder)
    assert followed.returncode == 0, followed.stderr
    (skew,) = json.loads((folder / "f.json").read_text())["events"]
    assert (skew["name"], skew["size"], skew["unit"]) == ("clock_skew_transmitters", 3.0, "s")
    assert (folder / "f.png").read_bytes().startswith(b"\x89PNG")


def test_valves_that_are_hardly_told_are_told_of(folder):
    """Of a row each 20 s a leak is not found, and nothing said so."""
    rows = (folder / "record.csv").read_text().splitlines()
    (folder / "sparse.csv").write_text("\n".join([rows[0], *rows[1:20_000:20]]))
    done = hrs("follow", "sparse.csv", "--tags", "tags.toml", "--station", "thesis-fit", cwd=folder)
    assert "no valve was told in 95% of the seconds" in done.stderr
    done = hrs("follow", "record.csv", "--tags", "tags.toml", "--station", "thesis-fit", cwd=folder)
    assert "no valve was told" not in done.stderr


def test_wrong_input_is_named(folder):
    done = hrs("follow", "none.csv", "--tags", "tags.toml", "--station", "thesis-fit", cwd=folder)
    assert (done.returncode, "cannot be read" in done.stderr) == (2, True)
    (folder / "few.toml").write_text('[[tags]]\ntag = "P"\ncolumn = "p"\nsensor = "pressure_high"\n')
    done = hrs("follow", "record.csv", "--tags", "few.toml", "--station", "thesis-fit", cwd=folder)
    assert (done.returncode, "missing inlet_high" in done.stderr) == (2, True)


@pytest.mark.slow
def test_a_simulated_record_without_noise_is_followed_and_nothing_is_frozen(tmp_path):
    assert hrs("simulate", "S3", "--controller", "switched", "--out", "day.csv", cwd=tmp_path).returncode == 0
    (tmp_path / "tags.toml").write_text(f'time = "time"\n{TAGS}')
    done = hrs(
        "follow", "day.csv", "--tags", "tags.toml", "--station", "thesis-fit", "--json", "f.json", cwd=tmp_path
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    document = json.loads((tmp_path / "f.json").read_text())
    assert (document["verdict"], document["events"]) == ("fits", [])
    assert max(channel["innovation_rms"] for channel in document["channels"].values()) < 1e-6
