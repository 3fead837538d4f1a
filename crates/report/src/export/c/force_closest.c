
/* Force of a point, from the output of the closest unit (equation 6). */
static float palpate_force_n(const float used[USED], int point)
{
    return used[CLOSEST[point]] / ROWS[point][CLOSEST[point]] * FORCES_N[point];
}
