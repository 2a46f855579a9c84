"""Old samples of twins, thinned to minutes."""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "twin_minutes",
        sa.Column("twin_id", sa.String(32), nullable=False),
        sa.Column("first_seq", sa.BigInteger, nullable=False),
        sa.Column("epoch", sa.Integer, nullable=False),
        sa.Column("rows", sa.Integer, nullable=False),
        sa.Column("stored", sa.Double, nullable=False),
        sa.Column("parquet", sa.LargeBinary, nullable=False),
        sa.PrimaryKeyConstraint("twin_id", "first_seq", name="pk_twin_minutes"),
        sa.ForeignKeyConstraint(["twin_id"], ["twins.id"], name="fk_twin_minutes", ondelete="CASCADE"),
    )
