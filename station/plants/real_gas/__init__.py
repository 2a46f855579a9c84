"""The faithful plant: hydrogen as a real gas, tanks with walls, flow by choked flux, fills that end by density.

Units of this room are SI without prefix: Pa, K, kg, kg/s, J, W, m, s. Files and commands spell theirs out.
"""
