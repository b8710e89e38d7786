def in_words(study): return "x"
