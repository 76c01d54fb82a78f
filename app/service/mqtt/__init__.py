"""MQTT: publish this car's state to a broker, and receive all cars of a broker for the fleet's page."""
