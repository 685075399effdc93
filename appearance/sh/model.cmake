gs_add_appearance(sh Sh)
