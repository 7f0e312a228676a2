"""The live estimator: a fast tick in the node, the nonlinear solver in a process of its own."""
