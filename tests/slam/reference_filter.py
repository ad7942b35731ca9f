# SPDX-License-Identifier: MIT
"""Algorithm 1 of Grisetti, Stachniss, Burgard (T-RO 2007), one particle after the other, in plain Python.

It draws its random numbers in the order in which the compiled filter draws them, so that both can be compared pose by
pose. Every scan is taken in; histories and maps are copied whole at each resampling.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass

import numpy as np

from slam import se2
from tests.slam.reference import Beams, Map, motion_cost, shares, sigmas

SPREAD = 1.2
"""Poses are drawn from the Laplace approximation, widened by this."""


@dataclass
class Particle:
    """A hypothesis: pose, map, logarithm of its weight, all its poses so far, and the error its pose was drawn with."""

    pose: np.ndarray
    map: Map
    log_weight: float
    path: list[np.ndarray]
    error: np.ndarray


class ReferenceFilter:
    """Feed it displacements and rays."""

    def __init__(self, config, seed):
        self.config = config
        self.rng = np.random.default_rng(seed)
        match, grid, n = config.match, config.map, config.particles
        far = grid.field_radius
        self.beams = Beams(match.hit_sigma, match.outlier_distance, match.beam_weight, far)
        self.coarse = Beams(match.hit_sigma, far, match.beam_weight * match.coarse_share, far)
        rng = np.random.default_rng(self.rng.bit_generator.state["state"]["state"])
        errors = math.sqrt(match.beam_weight) * rng.standard_normal((n, 3))
        self.particles = [
            Particle(np.zeros(3), Map(grid.cell, grid.wall_share, round(far / grid.cell)), -math.log(n), [], error)
            for error in errors
        ]

    def begin(self, rays):
        """The first scan: everybody draws it from the origin."""
        for particle in self.particles:
            particle.map.integrate_scan(particle.pose, rays)
            particle.path.append(particle.pose)

    def update(self, motion, rays):
        """One further scan; returns log gains (n,), effective sample size, and whether particles were resampled."""
        n = len(self.particles)
        log_gains = np.empty(n)
        near = self.rng.standard_normal((self.config.proposal.samples, 3))
        z = self.rng.standard_normal((n, 3))
        component = self.rng.uniform(size=n)
        self.rng.uniform(size=n)  # chooses among several optima, of which the reference knows only one
        for i, particle in enumerate(self.particles):
            density = Density(self, particle, motion, rays.ends[rays.hit])
            motion_model, u = self.config.motion, component[i]
            jumped = u >= 1.0 - motion_model.jump_share
            sigma = density.sigma[1 if u < motion_model.failure_share else 2 if jumped else 0]
            sample = se2.compose(density.guess, sigma * z[i])
            w = self.config.match.beam_weight
            kept = (1.0 - w) / (1.0 + w)
            particle.error = kept * particle.error + math.sqrt(w) * math.sqrt(1.0 - kept**2) * z[i]
            particle.pose, log_gains[i] = self.proposed(density, sample, near, particle.error)
            particle.log_weight += self.config.match.weight_share * log_gains[i]
            particle.map.integrate_scan(particle.pose, rays)
            particle.path.append(particle.pose)
        weights = self.weights
        for particle, weight in zip(self.particles, weights, strict=True):
            particle.log_weight = math.log(weight)
        ess = 1.0 / np.sum(weights**2)
        policy = self.config.resample
        if policy.when == "never" or (policy.when == "ess" and ess >= policy.threshold * n):
            return log_gains, ess, False
        self.resample(weights)
        return log_gains, ess, True

    @property
    def weights(self):
        logs = np.array([particle.log_weight for particle in self.particles])
        values = np.exp(logs - logs.max())
        return values / values.sum()

    def resample(self, weights):
        """Systematic: the particles at n evenly spaced points of the cumulated weights."""
        n, u = len(weights), self.rng.uniform()
        chosen, total, i = [], weights[0], 0
        for k in range(n):
            while (k + u) / n >= total:
                i += 1
                total += weights[i]
            chosen.append(copy.deepcopy(self.particles[i]))
            chosen[-1].log_weight = -math.log(n)
        self.particles = chosen

    def proposed(self, density, sample, near, error):
        """New pose of one particle and the logarithm of the factor of its weight; sample: from the motion model."""
        kind = self.config.proposal.kind
        if kind == "scan-match":
            density.guess = sample
        optimum, H = self.optimum(density) if kind != "motion" else (None, None)
        if kind == "motion" or density.matched(optimum) < self.config.match.min_matched_share:
            return sample, -density.scan(sample)
        if kind == "scan-match":
            return optimum, -density.scan(optimum)
        return improved(density, optimum, H, near, error)

    def optimum(self, density):
        """The lower of the minima reached from the predicted pose and from the most promising other start."""
        match = self.config.match
        driven = float(np.hypot(*density.motion[:2]))
        reach = min(max(0.5 * match.search_reach, 2.0 * driven), match.search_reach)
        count = math.ceil(reach / match.search_step)
        shifts = [k * match.search_step for k in range(-count, count + 1) if k != 0]
        starts = [density.guess, *(se2.compose(density.guess, (shift, 0.0, 0.0)) for shift in shifts)]
        start = min(starts, key=lambda pose: density.coarse(pose, self.coarse) + density.prior(pose))
        found = [density.descend(density.guess, match.iterations)]
        if start is not density.guess:
            found.append(density.descend(start, match.iterations))
        _, pose, H = min(found, key=lambda one: one[0])
        return pose, H


def improved(density, optimum, H, near, error):
    """Gaussian through weighted poses about the optimum (equations 16 to 18), a draw from it, and log eta."""
    root = np.linalg.cholesky(np.linalg.inv(H)[::-1, ::-1])[::-1, ::-1]  # upper: covariance = root root^T
    offsets = SPREAD * near @ root.T
    log_q = -0.5 * (near**2).sum(axis=1) - 1.5 * math.log(2.0 * math.pi) - math.log(SPREAD**3 * np.linalg.det(root))
    logs = np.array([-density.cost(optimum + offset) for offset in offsets]) - log_q
    weights = np.exp(logs - logs.max())
    log_eta = logs.max() + math.log(weights.mean())
    weights /= weights.sum()
    mean = weights @ offsets
    covariance = sum(w * np.outer(o - mean, o - mean) for w, o in zip(weights, offsets, strict=True))
    pose = optimum + mean + np.linalg.cholesky(covariance) @ error
    pose[2] = se2.wrap_angle(pose[2])
    return pose, log_eta


class Density:
    """p(z | m, x) p(x | x', u) as a function of x, for one particle and one scan."""

    def __init__(self, owner, particle, motion, hits):
        self.map, self.hits, self.motion = particle.map, hits, motion
        self.beams = owner.beams
        self.guess = se2.compose(particle.pose, motion)
        self.sigma = sigmas(motion, owner.config.motion)
        self.shares = shares(owner.config.motion)
        self.coarse_beams = owner.config.match.coarse_beams

    def scan(self, pose):
        return self.beams.cost(self.map, pose, self.hits)

    def coarse(self, pose, beams):
        """The same by every k-th hit, which stands for k."""
        few = self.hits[:: max(1, len(self.hits) // self.coarse_beams)]
        return beams.cost(self.map, pose, few) * len(self.hits) / len(few)

    def prior(self, pose):
        return motion_cost(se2.between(self.guess, pose), self.sigma, self.shares)

    def cost(self, pose):
        return self.scan(pose) + self.prior(pose)

    def matched(self, pose):
        return self.beams.matched(self.map, pose, self.hits)

    def residuals(self, pose):
        """Distances [m] by which the beams pull: two a beam, or one where the wall is a lone point."""
        out = np.zeros((len(self.hits), 2))
        for k, point in enumerate(se2.transform_points(pose, self.hits)):
            away = self.map.residual(point)
            if away is not None:
                place = self.map.nearest_wall(tuple(np.floor(point / self.map.cell).astype(int).tolist()))
                lone = self.map.cells[place].normal is None
                out[k] = (np.hypot(*away), 0.0) if lone else away
        return out

    def descend(self, start, iterations):
        """Gauss-Newton with step halving: cost, pose, Hessian. Derivatives are differences."""
        best, best_pose, best_H = math.inf, None, None
        pose, step = start, np.zeros(3)
        for _ in range(iterations):
            cost = self.cost(pose)
            improved = cost < best - 1e-6
            if improved:
                H, g = self.linearised(pose)
                best, best_pose, best_H = cost, pose, H
                step = np.linalg.solve(H, g)
            else:
                step = 0.5 * step
            if np.all(np.abs(step) < (1e-3, 1e-3, 5e-4)):
                if improved:
                    best, best_pose = best - 0.5 * g @ step, best_pose - step
                break
            pose = best_pose - step
        return best, best_pose, best_H

    def linearised(self, pose):
        """Hessian as of iteratively reweighted least squares, and the gradient."""
        h, r = 1e-7, self.residuals(pose)
        ahead = np.array([self.residuals(pose + d) - r for d in h * np.eye(3)]) / h
        back = np.array([r - self.residuals(pose - d) for d in h * np.eye(3)]) / h
        J = np.where(np.abs(ahead) < np.abs(back), ahead, back)  # a beam jumps to another wall on one side only
        w = (1.0 + (r**2).sum(axis=1) / self.beams.outlier**2) ** -2.0 * self.beams.weight / self.beams.sigma**2
        H, g = np.einsum("akr,bkr,k->ab", J, J, w), np.einsum("akr,kr,k->a", J, r, w)
        deviation = se2.between(self.guess, pose)
        logs = [
            -0.5 * np.sum((deviation / s) ** 2) - np.log(s).sum() + math.log(max(share, 1e-300))
            for s, share in zip(self.sigma, self.shares, strict=True)
        ]
        held = np.exp(np.array(logs) - max(logs))
        precision = (held / held.sum()) @ self.sigma**-2.0
        cos, sin = math.cos(self.guess[2]), math.sin(self.guess[2])
        R = np.array([(cos, sin, 0.0), (-sin, cos, 0.0), (0.0, 0.0, 1.0)])
        return H + R.T @ np.diag(precision) @ R, g + R.T @ (precision * deviation)
