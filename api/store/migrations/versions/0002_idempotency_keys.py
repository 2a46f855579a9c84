"""Idempotency keys, and indexes for lists in pages."""

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "idempotency_keys",
        sa.Column("owner", sa.String(64), nullable=False),
        sa.Column("key", sa.String(255), nullable=False),
        sa.Column("request", sa.LargeBinary(32), nullable=False),
        sa.Column("created", sa.Double, nullable=False),
        sa.Column("status", sa.SmallInteger, nullable=False),
        sa.Column("location", sa.String(200), nullable=False),
        sa.Column("body", sa.LargeBinary, nullable=False),
        sa.PrimaryKeyConstraint("owner", "key", name="pk_idempotency_keys"),
    )
    op.create_index("ix_idempotency_keys_created", "idempotency_keys", ["created"])
    op.drop_index("ix_jobs_kind_id", "jobs")
    op.create_index("ix_jobs_kind_created_id", "jobs", ["kind", "created", "id"])
    op.create_index("ix_jobs_kind_state_created_id", "jobs", ["kind", "state", "created", "id"])
    op.create_index("ix_twins_instance_created_id", "twins", ["instance", "created", "id"])
