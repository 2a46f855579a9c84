"""Measurements that live twins follow a station by."""

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("twins", sa.Column("measured", sa.BigInteger, nullable=False, server_default="0"))
    op.create_table(
        "measurements",
        sa.Column("twin_id", sa.String(32), nullable=False),
        sa.Column("source", sa.String(64), nullable=False),
        sa.Column("sequence", sa.BigInteger, nullable=False),
        sa.Column("number", sa.BigInteger, nullable=False),
        sa.Column("digest", sa.String(64), nullable=False),
        sa.Column("samples", sa.Integer, nullable=False),
        sa.Column("stored", sa.Double, nullable=False),
        sa.Column("payload", sa.LargeBinary),
        sa.PrimaryKeyConstraint("twin_id", "source", "sequence", name="pk_measurements"),
        sa.ForeignKeyConstraint(["twin_id"], ["twins.id"], name="fk_measurements", ondelete="CASCADE"),
    )
    op.create_index("ix_measurements_twin_id_number", "measurements", ["twin_id", "number"], unique=True)
