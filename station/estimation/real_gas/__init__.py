"""The estimation model of the faithful plant: its own second, differentiated, in an extended Kalman filter."""
