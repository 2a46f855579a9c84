"""Settings of the service: one object, each field with its default, limit and reason; HRS_* variables set them."""

from __future__ import annotations

import ipaddress
import os
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import urlsplit

from pydantic import AnyHttpUrl, Field, ValidationError, ValidationInfo, field_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

from api.logs import LogFormat
from api.nearest import nearest
from station import InputError

_DATABASES = ("postgresql", "postgres", "postgresql+psycopg", "sqlite")
"""Schemes of the two databases."""

NOT_SETTINGS = ("HRS_TEST_POSTGRES", "HRS_BENCH_POSTGRES", "HRS_MEASURED")
"""Variables that tests and benchmarks read."""

PROCESSES = "processes"
"""The executor that needs nothing else."""


def _data_folder() -> Path:
    base = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(base) / "hrs-twin"


def is_loopback(host: str) -> bool:
    """Whether only programs of this machine reach `host`."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def _is_loopback_endpoint(endpoint: str) -> bool:
    return is_loopback(endpoint.partition("/")[2].rpartition(":")[0])


class Settings(BaseSettings):
    """How the service runs; `hrs serve --help` has the common ones as options."""

    model_config = SettingsConfigDict(env_prefix="HRS_", extra="ignore", frozen=True)

    host: Annotated[str, Field(description="Address to listen on; any but loopback asks every request for a key")] = (
        "127.0.0.1"
    )
    port: Annotated[int, Field(ge=0, le=65535, description="Port of the API; 0 takes a free one")] = 8000
    url: Annotated[AnyHttpUrl | None, Field(description="Where the command line finds the service")] = None
    allowed_origins: Annotated[
        list[Annotated[str, Field(pattern=r"^https?://([a-z0-9.-]+|\[[0-9a-f:]+\])(:[0-9]+)?$")]],
        Field(
            description="Origins, as JSON, besides the service's own whose pages may send requests, such as "
            '["https://station.example"]: for a proxy that replaces Host'
        ),
    ] = []
    api_key: Annotated[
        str | None, Field(description="Key the command line sends to a service that asks for one", repr=False)
    ] = None
    data: Annotated[Path, Field(description="Folder of the embedded database")] = Field(default_factory=_data_folder)
    database: Annotated[
        str | None,
        Field(description="postgresql://user:password@host/name; without it SQLite in the data folder", repr=False),
    ] = None
    instance: Annotated[
        str, Field(min_length=1, max_length=64, description="Name of this server among those on one database")
    ] = "hrs"

    zenoh_certificate: Annotated[
        Path | None, Field(description="Certificate that the embedded zenoh router shows at tls/ endpoints: a PEM file")
    ] = None
    zenoh_private_key: Annotated[
        Path | None, Field(description="Private key of that certificate: a PEM file", repr=False)
    ] = None
    zenoh_plaintext: Annotated[
        bool, Field(description="Let other machines use zenoh without TLS: in a network nobody else is in")
    ] = False
    zenoh_listen: Annotated[
        str,
        Field(
            validate_default=True,
            description="Endpoint of the embedded zenoh router; any but loopback must be tls/ and asks every client "
            "for the user and password of a key",
        ),
    ] = "tcp/127.0.0.1:7447"
    zenoh_secret: Annotated[
        Path | None,
        Field(description="File whose content zenoh passwords are made from; default zenoh.secret in the data folder"),
    ] = None
    zenoh_connect: Annotated[
        str | None, Field(description="Endpoint of a zenoh router of yours, used instead of the embedded one")
    ] = None
    zenoh_user: Annotated[
        str | None, Field(description="User that zenoh_connect and `hrs watch` name at a router that asks for one")
    ] = None
    zenoh_password: Annotated[str | None, Field(description="Password of that user", repr=False)] = None
    zenoh_ca: Annotated[
        Path | None,
        Field(
            description="Authority that must have signed a router's certificate: a PEM file; default the public ones"
        ),
    ] = None
    mqtt_password: Annotated[
        str | None, Field(description="Password of the user that `hrs mqtt` names at a broker", repr=False)
    ] = None
    opcua_password: Annotated[
        str | None, Field(description="Password of the user that `hrs opcua follow` names at a server", repr=False)
    ] = None
    demo: Annotated[bool, Field(description="Start live twins, one that follows another, if no twin is there")] = False

    workers: Annotated[int | None, Field(ge=0, le=256, description="Worker processes; default one a core")] = None
    executor: Annotated[
        str,
        Field(
            pattern=rf"^({PROCESSES}|dask://[^/\s]+:[0-9]+)$",
            description=f"Who computes jobs: {PROCESSES} of this machine, or a scheduler at dask://host:port",
        ),
    ] = PROCESSES
    lease_s: Annotated[
        float,
        Field(
            ge=1,
            le=3600,
            description="A worker silent for so long has lost its work to another; it reports three times in it",
        ),
    ] = 15.0
    attempts_max: Annotated[
        int, Field(ge=1, le=1000, description="A piece of work that took down so many workers fails its job")
    ] = 20

    chunk_max_s: Annotated[
        float,
        Field(gt=0, description="A run or a question that takes longer fails its job"),
    ] = 3600.0

    body_bytes_max: Annotated[
        int, Field(ge=1000, description="Largest request body; a trace of 20 000 vehicles takes 1.6 MB")
    ] = 4_000_000
    body_values_max: Annotated[
        int, Field(ge=1000, description="Values in a JSON body; a trace of 20 000 vehicles has 100 000")
    ] = 250_000
    body_keys_max: Annotated[int, Field(ge=100, description="Keys in an object of a JSON body")] = 1_000
    body_depth_max: Annotated[int, Field(ge=16, le=500, description="Levels of lists and objects in a JSON body")] = 32
    body_rate_min: Annotated[
        float,
        Field(
            gt=0,
            description="A body must come this fast on average, beyond its first headers_max_s",
            json_schema_extra={"unit": "bytes/s"},
        ),
    ] = 2_000.0
    headers_max_s: Annotated[float, Field(gt=0, le=600, description="The headers of a request must come within")] = 10.0
    headers_bytes_max: Annotated[int, Field(ge=4_096, description="Address and headers of a request together")] = 65_536
    idle_max_s: Annotated[float, Field(gt=0, description="A connection without a request is closed after")] = 30.0
    unread_max_s: Annotated[
        float, Field(gt=0, description="A client that takes nothing of its answer for so long is cut off")
    ] = 30.0
    connections_max: Annotated[
        int | None,
        Field(
            ge=16,
            description="Connections at once; default 10 000, or as many as the limit of open files leaves beside 384",
        ),
    ] = None
    replications_max: Annotated[int, Field(ge=1, description="Replications of one comparison")] = 10_000
    runs_max: Annotated[int, Field(ge=1, description="Runs of one comparison: some 3 h of one core at 30 ms each")] = (
        400_000
    )
    records_max: Annotated[
        int,
        Field(ge=1, description="Runs of one comparison that stores their records: some 1.5 MB each for a day in full"),
    ] = 2_000
    calibration_max_s: Annotated[
        float,
        Field(
            ge=21_600,
            le=864_000,
            description="Longest stretch of measurements that one calibration takes; a day takes 6 MB of the store",
        ),
    ] = 86_400.0
    horizon_max: Annotated[
        int, Field(ge=1, description="Longest horizon of a controller; 10 may take 4 s a second")
    ] = 10
    duration_max_s: Annotated[float, Field(gt=0, description="Longest time limit of a scenario")] = 8 * 86_400.0
    jobs_max: Annotated[int, Field(ge=1, description="Jobs waiting or running at once")] = 1_000
    checks_max: Annotated[
        int, Field(ge=1, le=64, description="Certificates that requests have checked at once, a process each")
    ] = 2
    check_cpu_s: Annotated[
        float,
        Field(
            gt=0, le=3600, description="Time of a core that a check of a certificate may take; one of service takes 10"
        ),
    ] = 60.0
    check_wall_s: Annotated[
        float,
        Field(gt=0, le=7200, description="A check that has not had that time of a core by then is given up"),
    ] = 180.0
    check_memory_bytes: Annotated[
        int,
        Field(
            ge=16_000_000,
            description="Address space that a check may take beyond its imports; one of service takes 400 MB",
        ),
    ] = 2_000_000_000
    checkpoint_s: Annotated[
        float,
        Field(
            ge=0.1,
            le=60,
            description="A live twin stores where it stands this often; a power cut costs so much. One that has a log "
            "of measurements does each fifth time",
        ),
    ] = 2.0
    twins_max: Annotated[int, Field(ge=0, description="Live twins at once")] = 50
    scenarios_max: Annotated[
        int, Field(ge=0, le=1_000, description="Scenarios of users that are stored; lists hold them all")
    ] = 200
    scenario_bytes_max: Annotated[
        int,
        Field(ge=1_000, description="Largest scenario stored, every parameter filled in; 20 000 vehicles take 2.2 MB"),
    ] = 4_000_000
    store_bytes_max: Annotated[
        int | None,
        Field(
            ge=20_000_000,
            description="A store that takes so much is given no new jobs and twins; what was accepted is still stored. "
            "Unset leaves it to disk_free_min_bytes: how much of a disk is whose, only its owner knows",
        ),
    ] = None
    disk_free_min_bytes: Annotated[
        int,
        Field(
            ge=0,
            description="The embedded database takes no new jobs and twins where its disk has less left: the reserve "
            "for checkpoints, and for results of what was accepted",
        ),
    ] = 500_000_000
    thin_days: Annotated[
        float | None,
        Field(
            gt=0,
            description="Samples of twins that are older are kept as minutes: mean, least and most of each column; "
            "events `valve_change` and `shield_refusal` as old are forgotten. Unset keeps every second",
        ),
    ] = None
    retention_days: Annotated[
        float | None,
        Field(gt=0, description="Finished jobs, and samples of twins, are kept so long; unset keeps them for ever"),
    ] = 30.0

    idempotency_retention_h: Annotated[
        float,
        Field(gt=0, le=8760, description="An answer is kept so long under its Idempotency-Key"),
    ] = 24.0
    idempotency_keys_max: Annotated[
        int, Field(ge=1, description="Answers kept at once, some 1 kB each; a request with a new key is refused then")
    ] = 100_000

    rate_limit_per_s: Annotated[
        float,
        Field(
            gt=0,
            description="Requests of one key (of one address, where it shows none that is valid) in the long run",
            json_schema_extra={"unit": "1/s"},
        ),
    ] = 100.0
    rate_limit_burst: Annotated[
        int, Field(ge=1, description="Requests of one key at once; a page that opens asks some twenty times")
    ] = 500
    rate_limit_loopback: Annotated[
        bool, Field(description="Whether a service on loopback, which asks for no key, limits its clients, too")
    ] = False

    stop_s: Annotated[
        float,
        Field(gt=0, le=60, description="Open requests get so long to end after SIGTERM"),
    ] = 1.0

    log_format: Annotated[
        LogFormat,
        Field(description="Of the lines on stderr: `text` for people, `json` for programs, one object a line"),
    ] = "text"
    access_log: Annotated[bool, Field(description="A line for every request: method, path, status")] = False

    @field_validator("database")
    @classmethod
    def _known_database(cls, url: str | None) -> str | None:
        scheme, separator, place = (url or "").partition("://")
        if url is not None and not (separator and scheme in _DATABASES and place):
            given = f"{scheme:.40}://..." if separator else "a text without a scheme"
            raise ValueError(
                f"must be postgresql://user:password@host/name or sqlite:////folder/file.db; given {given}"
            )
        try:
            urlsplit(url or "").port  # noqa: B018  # it raises where the port is none
        except ValueError:
            raise ValueError("must have a number as its port; in a password %2F is a slash, %3A a colon") from None
        return url

    @field_validator("zenoh_listen")
    @classmethod
    def _secure(cls, endpoint: str, info: ValidationInfo) -> str:
        protocol, _, place = endpoint.partition("/")
        if not protocol or not place.rpartition(":")[0]:
            raise ValueError(f"must be an endpoint like tcp/127.0.0.1:7447; given {endpoint!r}")
        if protocol == "tls" and not (info.data.get("zenoh_certificate") and info.data.get("zenoh_private_key")):
            raise ValueError("is a tls/ endpoint: it needs zenoh_certificate and zenoh_private_key")
        if protocol != "tls" and not _is_loopback_endpoint(endpoint) and not info.data.get("zenoh_plaintext"):
            raise ValueError(
                "must be a loopback endpoint like tcp/127.0.0.1:7447, or one with TLS like tls/0.0.0.0:7447; "
                "where nobody else is in the network, zenoh_plaintext allows others"
            )
        return endpoint

    @property
    def keys_required(self) -> bool:
        """Whether every request must carry a key."""
        return not is_loopback(self.host)

    @property
    def zenoh_keys_required(self) -> bool:
        """Whether the embedded router asks every client for the user and password of a key."""
        return self.zenoh_connect is None and not _is_loopback_endpoint(self.zenoh_listen)

    @property
    def zenoh_secret_file(self) -> Path:
        """The file of the secret that zenoh passwords are made from."""
        return self.zenoh_secret or self.data / "zenoh.secret"

    @cached_property
    def database_url(self) -> str:
        """The database as SQLAlchemy writes it."""
        if self.database is None:
            return f"sqlite:///{self.data / 'hrs.db'}"
        for scheme in ("postgresql://", "postgres://"):
            if self.database.startswith(scheme):
                return "postgresql+psycopg://" + self.database.removeprefix(scheme)
        return self.database

    @property
    def service_url(self) -> str:
        """The address at which a program of this machine finds the service, without a slash at the end."""
        if self.url is not None:
            return str(self.url).rstrip("/")
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{host}:{self.port}"


def _check_variables() -> None:
    """Raise InputError for an HRS_ variable that sets nothing: a slip in one that protects must not go unseen."""
    known = [*(f"HRS_{name.upper()}" for name in Settings.model_fields), *NOT_SETTINGS]
    problems = [
        (name, f"is no setting{nearest(name.upper(), known)}")
        for name in sorted(os.environ)
        if name.upper().startswith("HRS_") and name.upper() not in known
    ]
    if problems:
        raise InputError("environment", problems)


def load_settings(**given: Any) -> Settings:
    """Settings from the environment with `given` laid over them; None counts as not given.

    Raises
    ------
    InputError
        naming the setting and its limit.
    """
    _check_variables()
    try:
        return Settings(**{name: value for name, value in given.items() if value is not None})
    except ValidationError as error:
        raise InputError.of("settings (HRS_* variables or options)", error) from None
