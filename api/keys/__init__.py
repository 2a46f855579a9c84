"""Keys over REST: who may use the service, and for what."""
