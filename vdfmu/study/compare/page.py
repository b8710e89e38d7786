def write_comparison(study): pass
