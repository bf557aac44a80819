"""Small least-squares problems with weights that must not be negative, many at once."""

from cape.kernels.jit import routine

STILL = 1e-13  # change of all weights in a sweep at which there is nothing more to gain
FIRST_RIDGE = 1.0
FALL = 0.9  # of the ridge from sweep to sweep


@routine
def fit_weights(vectors, target, sweeps, ridge, normal, wanted, weights):
    """Find weights q >= 0 of S unit vectors (P, S, K) whose sum is nearest to a target (K,), for each of P problems.

    Projected Gauss-Seidel on the normal equations, whose diagonal a ridge raises so that the weights are unique. It
    falls to `ridge`: under a small one from the start the first of vectors that do the same would keep all the weight.
    Filled: `weights` (P, S); `normal` (S, S) and `wanted` (S,) are room.
    """
    count, dimensions = vectors.shape[1], vectors.shape[2]
    for p in range(vectors.shape[0]):
        for s in range(count):
            weights[p, s] = 0.0
            wanted[s] = 0.0
            for k in range(dimensions):
                wanted[s] += vectors[p, s, k] * target[k]
            for r in range(count):
                normal[s, r] = 0.0
                for k in range(dimensions):
                    normal[s, r] += vectors[p, s, k] * vectors[p, r, k]
        raised = FIRST_RIDGE
        for _ in range(sweeps):
            raised = max(FALL * raised, ridge)
            change = 0.0
            for s in range(count):
                residual = wanted[s] + weights[p, s]
                for r in range(count):
                    residual -= normal[s, r] * weights[p, r]
                weight = max(residual / (1.0 + raised), 0.0)
                change = max(change, abs(weight - weights[p, s]))
                weights[p, s] = weight
            if change < STILL:
                break
