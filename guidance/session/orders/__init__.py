"""Orders of people and missions: where they arrive, how they wait, and what is answered."""
