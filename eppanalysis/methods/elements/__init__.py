"""What an element's rules are worth: whether they are unambiguous and can chatter, and what energy they take up."""
