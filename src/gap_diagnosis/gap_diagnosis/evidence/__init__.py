"""From gains to judgements: where, how sure, which experiment separates."""
