"""Notes of people on the time axis of twins."""

import sqlalchemy as sa
from alembic import op

revision = "0009"
down_revision = "0008"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "twin_notes",
        sa.Column("twin_id", sa.String(32), nullable=False),
        sa.Column("id", sa.String(32), nullable=False),
        sa.Column("time_s", sa.Double, nullable=False),
        sa.Column("to_s", sa.Double),
        sa.Column("text", sa.String(500), nullable=False),
        sa.Column("author", sa.String(64), nullable=False),
        sa.Column("created", sa.Double, nullable=False),
        sa.PrimaryKeyConstraint("twin_id", "id", name="pk_twin_notes"),
        sa.ForeignKeyConstraint(["twin_id"], ["twins.id"], name="fk_twin_notes", ondelete="CASCADE"),
    )
