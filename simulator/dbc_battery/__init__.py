"""Batteries other than the team's own: any shape, an ordinary BMS, and a voice on CAN that is given from outside."""
