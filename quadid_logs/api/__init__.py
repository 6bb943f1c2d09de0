"""The Python interface: `analyze` and the other verbs, and models that simulate and predict.

`quadid_logs` exports the names of this package. The stages of the analysis return plain data. The classes
here add the methods that need the data of several stages.
"""
