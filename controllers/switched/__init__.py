"""MPC over admissible switching signals: blocks, a beam search over the model, the value of stored gas."""
