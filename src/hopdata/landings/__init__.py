"""Landings: floor, sections, contact instants and schedules, and the home frame."""
