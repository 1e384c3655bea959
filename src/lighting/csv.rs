//! The table of a lighting in files: `theta_deg,L_R,L_G,L_B,…`.
