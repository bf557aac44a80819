"""A scene as the arrays that kernels work on."""
