"""The temperature sensor inside an Energus module: its voltage at a temperature.

Source: the 33 points that Energus publishes, -40 to 120 degC in steps of 5 K. The curve falls: about 12 mV/K at
25 degC, but only 1 to 2 mV/K below -30 and above 100 degC. Linear between the points.
"""

FIRST_DEGC = -40
STEP_DEGC = 5
# fmt: off
POINTS_V = (
    2.44, 2.42, 2.40, 2.38, 2.35, 2.32, 2.27, 2.23,  # -40 to -5 degC
    2.17, 2.11, 2.05, 1.99, 1.92, 1.86, 1.80, 1.74,  # 0 to 35
    1.68, 1.63, 1.59, 1.55, 1.51, 1.48, 1.45, 1.43,  # 40 to 75
    1.40, 1.38, 1.37, 1.35, 1.34, 1.33, 1.32, 1.31, 1.30,  # 80 to 120
)
# fmt: on
MARGIN_V = 0.005  # half of the table's last digit
