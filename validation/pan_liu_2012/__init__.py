"""Tables and computed figures of Pan & Liu, Theor. Appl. Mech. Lett. 2 (2012) 063006."""
