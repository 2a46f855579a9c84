"""TLS and passwords at a broker: what is given is used, and what does not fit is refused."""

from __future__ import annotations

import shutil
import subprocess
import threading

import pytest
import trustme

from api.bridges.mqtt.broker import Broker, BrokerError
from api.bridges.mqtt.publish import Publisher
from api.client import Service
from tests.api.bridges.mqtt.conftest import MOSQUITTO, Mosquitto
from tests.api.conftest import RunningService

PASSWD = shutil.which("mosquitto_passwd")

pytestmark = [
    pytest.mark.slow,  # a service is started for them
    # paho leaves a socket whose handshake fails to the collector
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
    pytest.mark.skipif(MOSQUITTO is None or PASSWD is None, reason="mosquitto is not installed"),
]


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    """A service that computes no jobs."""
    started = RunningService(tmp_path_factory.mktemp("mqtt"), "--workers", "0")
    yield started
    started.stop()


def test_a_broker_with_tls_and_users_is_used_as_told_and_no_other(running, tmp_path):
    authority, stranger = trustme.CA(), trustme.CA()
    certificate = authority.issue_cert("localhost")
    authority.cert_pem.write_to_path(tmp_path / "ca.pem")
    stranger.cert_pem.write_to_path(tmp_path / "stranger.pem")
    certificate.private_key_pem.write_to_path(tmp_path / "key.pem")
    for part in certificate.cert_chain_pems:
        part.write_to_path(tmp_path / "cert.pem", append=True)
    subprocess.run([PASSWD, "-c", "-b", tmp_path / "users", "ann", "right"], check=True, capture_output=True)
    files = (f"certfile {tmp_path}/cert.pem", f"keyfile {tmp_path}/key.pem", f"password_file {tmp_path}/users")
    broker = Mosquitto(tmp_path, "allow_anonymous false", *files)
    url = f"mqtts://ann@localhost:{broker.port}"
    try:
        with Service(url=running.url) as service:
            twin = service.start("S1", paused=True)
            twin.stop()
            told = Broker.parse(url, password="right", ca=tmp_path / "ca.pem")  # noqa: S106  # of a broker of ours
            assert Publisher(twin, told).run(threading.Event())
            wrong = told._replace(password="wrong")  # noqa: S106  # likewise
            with pytest.raises(BrokerError, match="the broker refuses: Not authorized") as caught:
                Publisher(twin, wrong).run(threading.Event())
            assert "wrong" not in str(caught.value)
            with pytest.raises(BrokerError, match="certificate verify failed"):
                Publisher(twin, told._replace(ca=tmp_path / "stranger.pem")).run(threading.Event())
            plain = Broker.parse(f"mqtt://ann@localhost:{broker.port}", password="right")  # noqa: S106  # likewise
            with pytest.raises(BrokerError, match=r"no answer|no broker answers|refuses"):
                Publisher(twin, plain).run(threading.Event())
    finally:
        broker.stop()
