
/* Solves a reading: the point whose outputs correlate best with it (Sensors 2018, 18, 351, steps 3 and 4). Returns the verdict.
   Needs no heap and changes no static data. */
int palpate_solve(const float *outputs, struct palpate_contact *contact)
{
    float used[USED], direction[USED], most = 0.0f, mean = 0.0f, length = 0.0f, least = INFINITY, force, softness;
    int unit, point, best = 0;
    contact->x_mm = contact->y_mm = contact->force_n = contact->misfit = contact->relative_force = NAN;
    contact->unit = 0;
    contact->verdict = PALPATE_UNSOLVED;
    if (!palpate_used(outputs, used)) return contact->verdict;
    for (unit = 0; unit < USED; unit++) most = fmaxf(most, fabsf(used[unit]));
    if (most == 0.0f) return contact->verdict;
    for (unit = 0; unit < USED; unit++) mean += used[unit] / most;
    mean /= USED;
    for (unit = 0; unit < USED; unit++) {
        direction[unit] = used[unit] / most - mean;
        length += direction[unit] * direction[unit];
    }
    length = sqrtf(length);
    if (!(length > LEAST_LENGTH)) return contact->verdict;
    for (unit = 0; unit < USED; unit++) direction[unit] /= length;
    /* 1 - r is half of the squared distance of two directions, and keeps more digits than r */
    for (point = 0; point < POINTS; point++) {
        float distance = 0.0f;
        for (unit = 0; unit < USED; unit++) {
            const float apart = direction[unit] - DIRECTIONS[point][unit];
            distance += apart * apart;
        }
        if (distance < least) {
            least = distance;
            best = point;
        }
    }
    force = palpate_force_n(used, best);
    if (!isfinite(force)) return contact->verdict;
    contact->x_mm = PLACES[best][0];
    contact->y_mm = PLACES[best][1];
    if (FORCES_ARE_KNOWN) contact->force_n = force;
    else contact->relative_force = force;
    softness = 1.0f / force;
    if (isfinite(MOST_RESIDUE[0])) {
        contact->misfit = 0.5f * least / (MOST_RESIDUE[0] + MOST_RESIDUE[1] * softness * softness);
    }
    if (palpate_is_weak(used)) contact->verdict = PALPATE_WEAK_SIGNAL;
    else if (contact->misfit > 1.0f) contact->verdict = PALPATE_NOT_ONE_CONTACT;
    else contact->verdict = PALPATE_OK;
    return contact->verdict;
}
