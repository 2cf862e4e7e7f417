"""Development sessions for the gap diagnosis, from machines that share no physics with it."""
