"""Orders of people and missions: their arrival, their queues and their answers."""
