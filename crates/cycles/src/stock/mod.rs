//! Stock removal along a contour (CYCLE95): from contour elements and a job to the list of moves.
