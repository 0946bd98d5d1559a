"""Methods of texture modelling side by side: sessions, judgements, and what is made of them."""
