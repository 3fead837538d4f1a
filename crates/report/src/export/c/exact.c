/* With these options a compiler assumes that no number is NAN or infinite, and the checks of a reading would go. */
#if defined(__FAST_MATH__) || defined(_M_FP_FAST) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__)
#error "this file needs NAN and infinity: compile it without -Ofast, -ffast-math, -ffinite-math-only and /fp:fast"
#endif

