"""Landings: floor, sections, contact instants, schedules, states, and the home frame."""
