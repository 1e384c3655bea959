//! The report: one function per figure, and the page that orders them.
