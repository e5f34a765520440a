"""The bar-hinge model: axial springs between nodes, torsional springs on dihedral angles.

`laws` holds the force laws as pure scalar functions, `kernels` compiles and assembles them,
`model` steps one experiment.
"""
