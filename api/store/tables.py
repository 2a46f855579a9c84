"""The tables; `migrations/` brings a database of any age to them."""

from __future__ import annotations

import sqlalchemy as sa

metadata = sa.MetaData(
    naming_convention={
        "ix": "ix_%(table_name)s_%(column_0_N_name)s",
        "pk": "pk_%(table_name)s",
        "fk": "fk_%(table_name)s",
        "uq": "uq_%(table_name)s_%(column_0_N_name)s",
    }
)

jobs = sa.Table(
    "jobs",
    metadata,
    sa.Column("id", sa.String(40), primary_key=True),
    sa.Column("kind", sa.String(16), nullable=False),
    sa.Column("about", sa.JSON, nullable=False),  # what lists and polls show of the spec
    sa.Column("spec", sa.JSON, nullable=False),  # what workers need; a trace makes it megabytes
    sa.Column("state", sa.String(16), nullable=False),
    sa.Column("created", sa.Double, nullable=False),  # Unix times [s]
    sa.Column("started", sa.Double),
    sa.Column("finished", sa.Double),
    sa.Column("runs", sa.Integer, nullable=False),
    sa.Column("runs_done", sa.Integer, nullable=False),
    sa.Column("error", sa.JSON(none_as_null=True)),
    sa.Column("progress", sa.Double),  # of a job of one chunk, while it works: 0 to 1
    sa.Index(None, "kind", "created", "id"),
    sa.Index(None, "kind", "state", "created", "id"),
    sa.Index(None, "state", "finished"),
)

chunks = sa.Table(
    "chunks",
    metadata,
    sa.Column("job_id", sa.ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
    sa.Column("number", sa.Integer, primary_key=True),
    sa.Column("work", sa.JSON, nullable=False),  # which runs
    sa.Column("runs", sa.Integer, nullable=False),
    sa.Column("priority", sa.SmallInteger, nullable=False),  # lower goes first
    sa.Column("open", sa.Boolean, nullable=False),  # whether it still has to be done
    sa.Column("attempt", sa.Integer, nullable=False),
    sa.Column("owner", sa.String(100)),
    sa.Column("lease_until", sa.Double, nullable=False),  # Unix time [s]; 0 when nobody holds it
    sa.Index(None, "open", "priority", "job_id", "number"),
)

results = sa.Table(
    "results",
    metadata,
    sa.Column("job_id", sa.ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
    sa.Column("number", sa.Integer, primary_key=True),
    sa.Column("rows", sa.LargeBinary, nullable=False),  # JSON array, one object a run
)

series = sa.Table(
    "series",
    metadata,
    sa.Column("job_id", sa.ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
    sa.Column("parquet", sa.LargeBinary, nullable=False),
)

run_records = sa.Table(
    "run_records",
    metadata,
    sa.Column("job_id", sa.ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
    sa.Column("number", sa.Integer, primary_key=True),  # of the run in the comparison's order
    sa.Column("parquet", sa.LargeBinary, nullable=False),
)

twins = sa.Table(
    "twins",
    metadata,
    sa.Column("id", sa.String(32), primary_key=True),
    sa.Column("instance", sa.String(64), nullable=False),
    sa.Column("settings", sa.JSON, nullable=False),
    sa.Column("changes", sa.JSON, nullable=False),  # of the settings since
    sa.Column("state", sa.String(16), nullable=False),
    sa.Column("epoch", sa.Integer, nullable=False),
    sa.Column("samples", sa.BigInteger, nullable=False),
    sa.Column("events", sa.BigInteger, nullable=False),
    sa.Column("created", sa.Double, nullable=False),
    sa.Column("changed", sa.Double, nullable=False),
    sa.Column("snapshot", sa.LargeBinary),
    sa.Column("measured", sa.BigInteger, nullable=False, server_default="0"),  # number of its last measurements
    sa.Index(None, "instance", "created", "id"),
)

twin_segments = sa.Table(
    "twin_segments",
    metadata,
    sa.Column("twin_id", sa.ForeignKey("twins.id", ondelete="CASCADE"), primary_key=True),
    sa.Column("first_seq", sa.BigInteger, primary_key=True),
    sa.Column("epoch", sa.Integer, nullable=False),  # a segment ends with its epoch
    sa.Column("rows", sa.Integer, nullable=False),
    sa.Column("stored", sa.Double, nullable=False),  # Unix time [s]
    sa.Column("parquet", sa.LargeBinary, nullable=False),
)

twin_minutes = sa.Table(
    "twin_minutes",
    metadata,
    sa.Column("twin_id", sa.ForeignKey("twins.id", ondelete="CASCADE"), primary_key=True),
    sa.Column("first_seq", sa.BigInteger, primary_key=True),
    sa.Column("epoch", sa.Integer, nullable=False),
    sa.Column("rows", sa.Integer, nullable=False),  # samples that these minutes stand for
    sa.Column("stored", sa.Double, nullable=False),  # of the newest of them: Unix time [s]
    sa.Column("parquet", sa.LargeBinary, nullable=False),
)

twin_events = sa.Table(
    "twin_events",
    metadata,
    sa.Column("twin_id", sa.ForeignKey("twins.id", ondelete="CASCADE"), primary_key=True),
    sa.Column("seq", sa.BigInteger, primary_key=True),
    sa.Column("stored", sa.Double, nullable=False),  # Unix time [s]
    sa.Column("document", sa.JSON, nullable=False),
)

twin_notes = sa.Table(
    "twin_notes",
    metadata,
    sa.Column("twin_id", sa.ForeignKey("twins.id", ondelete="CASCADE"), primary_key=True),
    sa.Column("id", sa.String(32), primary_key=True),
    sa.Column("time_s", sa.Double, nullable=False),  # since the twin's start
    sa.Column("to_s", sa.Double),  # null for a moment
    sa.Column("text", sa.String(500), nullable=False),
    sa.Column("author", sa.String(64), nullable=False),  # name of the API key
    sa.Column("created", sa.Double, nullable=False),  # Unix time [s]
)

measurements = sa.Table(
    "measurements",
    metadata,
    sa.Column("twin_id", sa.ForeignKey("twins.id", ondelete="CASCADE"), primary_key=True),
    sa.Column("source", sa.String(64), primary_key=True),
    sa.Column("sequence", sa.BigInteger, primary_key=True, autoincrement=False),  # as the source counts
    sa.Column("number", sa.BigInteger, nullable=False),  # in the order in which they came, from 1
    sa.Column("digest", sa.String(64), nullable=False),  # SHA-256 of the payload
    sa.Column("samples", sa.Integer, nullable=False),
    sa.Column("stored", sa.Double, nullable=False),  # Unix time [s]
    sa.Column("payload", sa.LargeBinary),  # null once a checkpoint has taken it in
    sa.Index(None, "twin_id", "number", unique=True),
)

scenarios = sa.Table(
    "scenarios",
    metadata,
    sa.Column("name", sa.String(64), primary_key=True),
    sa.Column("about", sa.JSON, nullable=False),  # what lists show of the document
    sa.Column("document", sa.JSON, nullable=False),  # with every parameter; a trace makes it megabytes
    sa.Column("digest", sa.String(64), nullable=False),  # SHA-256 of the document
    sa.Column("created", sa.Double, nullable=False),  # Unix times [s]
    sa.Column("changed", sa.Double, nullable=False),
)

keys = sa.Table(
    "keys",
    metadata,
    sa.Column("name", sa.String(64), primary_key=True),
    sa.Column("digest", sa.LargeBinary(32), nullable=False, unique=True),  # SHA-256 of 256 random bits
    sa.Column("created", sa.Double, nullable=False),
    sa.Column("revoked", sa.Double),
    sa.Column("scopes", sa.String(40), nullable=False, server_default="admin"),  # names apart by spaces
)

idempotency_keys = sa.Table(
    "idempotency_keys",
    metadata,
    sa.Column("owner", sa.String(64), primary_key=True),  # name of the API key; empty where none is needed
    sa.Column("key", sa.String(255), primary_key=True),
    sa.Column("request", sa.LargeBinary(32), nullable=False),  # SHA-256 of method, path and body
    sa.Column("created", sa.Double, nullable=False, index=True),
    sa.Column("status", sa.SmallInteger, nullable=False),
    sa.Column("location", sa.String(200), nullable=False),
    sa.Column("body", sa.LargeBinary, nullable=False),
)
