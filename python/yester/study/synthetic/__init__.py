"""Failures and strains of temporal methods, staged in small scenes whose truth a ray-caster knows exactly."""
