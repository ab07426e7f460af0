"""The powered elbow under extended physiological proprioception."""
