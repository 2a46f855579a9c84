"""PostgreSQL for what is fuzzed, as the tests of the service find or start it."""

from tests.api.conftest import module_postgres_url, postgres_server, postgres_url

__all__ = ["module_postgres_url", "postgres_server", "postgres_url"]
