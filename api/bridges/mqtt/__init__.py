"""MQTT: what a live twin tells, published to a broker, and measurements from it; the extra `mqtt` installs paho."""
