"""PostgreSQL for what is fuzzed, as the tests of the service find or start it."""

from tests.api.conftest import postgres_server, postgres_url

__all__ = ["postgres_server", "postgres_url"]
