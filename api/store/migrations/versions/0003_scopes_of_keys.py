"""What a key may do. Keys from before may do everything, as they could."""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("keys", sa.Column("scopes", sa.String(40), nullable=False, server_default="admin"))
