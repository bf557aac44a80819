"""Products with the linearised stiffness of a cloth, for the largest frequency that an explicit step must resolve."""

import math

from cape.kernels.jit import driver


@driver
def scaled_stiffness_times(v, root, first, second, stiffness, direction, members, coefficients, bend, image):
    """Set `image` to M^-1/2 K M^-1/2 v, all of shape (N, 3); `root` is M^-1/2 [kg^-1/2], shape (N,).

    K has k u u^T of each spring with unit vector u, `direction` (E, 3), and the bend springs as in `springs.Springs`.
    """
    image[:] = 0.0
    for e in range(first.size):
        i, j = first[e], second[e]
        along = 0.0
        for c in range(3):
            along += direction[e, c] * (root[j] * v[j, c] - root[i] * v[i, c])
        for c in range(3):
            pull = stiffness[e] * along * direction[e, c]
            image[i, c] -= root[i] * pull
            image[j, c] += root[j] * pull
    for b in range(bend.size):
        for c in range(3):
            curl = 0.0
            for a in range(members.shape[1]):
                curl += coefficients[b, a] * root[members[b, a]] * v[members[b, a], c]
            for a in range(members.shape[1]):
                image[members[b, a], c] += root[members[b, a]] * coefficients[b, a] * bend[b] * curl


@driver
def power_method(v, image, iterations, root, first, second, stiffness, direction, members, coefficients, bend):
    """Estimate the largest eigenvalue of M^-1/2 K M^-1/2 [1/s2], starting from `v`; `image` is room."""
    largest = 0.0
    for _ in range(iterations):
        squared = 0.0
        for i in range(v.shape[0]):
            squared += v[i, 0] * v[i, 0] + v[i, 1] * v[i, 1] + v[i, 2] * v[i, 2]
        if squared == 0.0:
            return 0.0
        scale = 1.0 / math.sqrt(squared)
        for i in range(v.shape[0]):
            for c in range(3):
                v[i, c] *= scale
        scaled_stiffness_times(v, root, first, second, stiffness, direction, members, coefficients, bend, image)
        largest = 0.0
        for i in range(v.shape[0]):
            for c in range(3):
                largest += v[i, c] * image[i, c]
                v[i, c] = image[i, c]
    return largest


@driver
def largest_bend_row(inverse_mass, members, coefficients, bend, rows):
    """Gershgorin's bound of the largest eigenvalue of M^-1 K for the bend springs alone [1/s2]; `rows` (N,) is room."""
    rows[:] = 0.0
    for b in range(bend.size):
        total = 0.0
        for a in range(members.shape[1]):
            total += abs(coefficients[b, a])
        for a in range(members.shape[1]):
            rows[members[b, a]] += bend[b] * abs(coefficients[b, a]) * total
    largest = 0.0
    for i in range(rows.size):
        largest = max(largest, rows[i] * inverse_mass[i])
    return largest
