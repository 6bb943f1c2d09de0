"""What Python programs call: a flight analyzed, its model as an object that simulates and predicts.

`quadid_logs` offers the names of this package. The stages hand on plain data; here it is given the methods
that need several of them.
"""
