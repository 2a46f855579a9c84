"""OPC UA: live twins served to clients, and measurements from a server; the extra `opcua` installs asyncua."""
