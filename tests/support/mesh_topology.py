"""What the tests of meshes count."""


def edges_of(table):
    return {tuple(sorted(pair)) for pair in table.tolist()}


def euler_characteristic(mesh):
    return mesh.n_nodes - len(mesh.bars) + len(mesh.faces)
