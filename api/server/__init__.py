"""The application: services, routes, OpenAPI document, health."""
