gs_add_appearance(toy Toy)
