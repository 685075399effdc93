gs_add_appearance(none None)
