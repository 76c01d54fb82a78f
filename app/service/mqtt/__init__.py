"""MQTT: publish this car's state to a broker, and hear all cars of a broker for the fleet's page."""
