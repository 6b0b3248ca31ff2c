"""Accuracy of the adaptive integrators over rtol: cases, references and tables."""
