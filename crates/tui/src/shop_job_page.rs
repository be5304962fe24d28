//! The page of the shop's jobs: which one is marked, what is shown of each, and what a key does (SHP-36).
//!
//! Invariant: the mark stays with its job when the list changes. Only `y`, at the question of a job that is ready while
//! no other one runs, starts a piece, or as many as the question shows.

use crate::keys::Key;
use crate::model::{ScreenModel, ScreenStage};
use crate::shop_job_table::{ShopJobRow, ShopJobTable};

/// Number of jobs that a page key skips.
const PAGE: usize = 10;
/// Maximum number of lines that the details can be scrolled.
const MAX_SCROLL: usize = 1_000;

/// What is shown of the jobs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum ShopJobView {
    /// The list.
    #[default]
    List,
    /// The details of the marked job, scrolled by this number of lines.
    Details(usize),
    /// The question whether so many pieces of it are started, one after the other.
    Start(u32),
}

/// The marked job, and what is shown.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct ShopJobMark {
    /// Name of the marked job; `None` before a key has moved the mark.
    pub(crate) chosen: Option<String>,
    /// What is shown.
    pub(crate) view: ShopJobView,
}

/// What follows a key.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum ShopJobChoice {
    /// The page shows this.
    Show(ShopJobMark),
    /// The same as before, for this reason.
    Refuse(String),
    /// The page closes.
    Close,
    /// The page closes, and so many pieces of the job of this name are started.
    Start(String, u32),
}

/// Index of the marked job: the chosen one, or the first that is ready, or the last.
pub(crate) fn marked(table: &ShopJobTable, chosen: Option<&str>) -> Option<usize> {
    let last = table.rows.len().checked_sub(1)?;
    let known = chosen.and_then(|id| table.rows.iter().position(|row| row.id == id));
    Some(known.or_else(|| table.rows.iter().position(|row| row.is_ready)).unwrap_or(last))
}

/// Whether a piece can be started: no job runs, or the one that ran has come to its end.
fn is_free(model: &ScreenModel) -> bool {
    match model.stage {
        ScreenStage::Setup | ScreenStage::Ended(_) => true,
        ScreenStage::Job => model.is_at_program_end(),
        ScreenStage::Resuming => false,
    }
}

/// Whether the question of the start still applies.
pub(crate) fn applies(model: &ScreenModel, mark: &ShopJobMark) -> bool {
    !matches!(mark.view, ShopJobView::Start(_)) || is_free(model)
}

/// What a key does on the page.
pub(crate) fn choice(model: &ScreenModel, mark: &ShopJobMark, key: Key) -> ShopJobChoice {
    let Some(table) = model.shop_jobs.as_deref() else { return ShopJobChoice::Close };
    let Some((at, row)) = marked(table, mark.chosen.as_deref()).and_then(|at| Some((at, table.rows.get(at)?))) else {
        return ShopJobChoice::Close;
    };
    let show = |view| ShopJobChoice::Show(ShopJobMark { chosen: Some(row.id.clone()), view });
    match (mark.view, key) {
        (ShopJobView::Start(pieces), Key::Char('y')) => match refusal(model, row) {
            None if pieces > row.most_pieces.max(1) => ShopJobChoice::Refuse("fewer pieces are missing now".into()),
            None => ShopJobChoice::Start(row.id.clone(), pieces),
            Some(why) => ShopJobChoice::Refuse(why),
        },
        // A key that repeats itself asks again, and answers nothing.
        (ShopJobView::Start(pieces), Key::Char('c')) => show(ShopJobView::Start(pieces)),
        (ShopJobView::Start(pieces), Key::Up | Key::Down) if row.most_pieces > 1 => {
            let changed = if key == Key::Up { pieces.saturating_add(1) } else { pieces.saturating_sub(1) };
            show(ShopJobView::Start(changed.clamp(1, row.most_pieces)))
        }
        (ShopJobView::Start(_), _) => show(ShopJobView::List),
        (_, Key::Char('c')) => match refusal(model, row) {
            None => show(ShopJobView::Start(1)),
            Some(why) => ShopJobChoice::Refuse(why),
        },
        (ShopJobView::Details(back), key) => match scrolled(back, key) {
            Some(back) => show(ShopJobView::Details(back)),
            None => show(ShopJobView::List),
        },
        (ShopJobView::List, Key::Enter) => show(ShopJobView::Details(0)),
        (ShopJobView::List, key) => match moved(at, table.rows.len(), key).and_then(|to| table.rows.get(to)) {
            Some(to) => ShopJobChoice::Show(ShopJobMark { chosen: Some(to.id.clone()), view: ShopJobView::List }),
            None => ShopJobChoice::Close,
        },
    }
}

fn moved(at: usize, count: usize, key: Key) -> Option<usize> {
    let to = match key {
        Key::Up => at.saturating_sub(1),
        Key::Down => at + 1,
        Key::PageUp => at.saturating_sub(PAGE),
        Key::PageDown => at + PAGE,
        _ => return None,
    };
    Some(to.min(count.saturating_sub(1)))
}

fn scrolled(back: usize, key: Key) -> Option<usize> {
    Some(match key {
        Key::Up => back.saturating_sub(1),
        Key::Down => (back + 1).min(MAX_SCROLL),
        Key::PageUp => back.saturating_sub(PAGE),
        Key::PageDown => (back + PAGE).min(MAX_SCROLL),
        _ => return None,
    })
}

/// Why no piece of the job can be started now.
fn refusal(model: &ScreenModel, row: &ShopJobRow) -> Option<String> {
    if !is_free(model) {
        return Some("a program is running or about to be resumed: its end comes first".into());
    }
    if !row.is_ready {
        // Ready, but not with this machine file.
        let why = row.warnings.first().filter(|_| row.state == "ready").cloned();
        return Some(why.unwrap_or_else(|| format!("the job is {}, not ready; Enter shows why", row.state)));
    }
    model.dry_run.then(|| "a dry run makes no piece: switch it off first (d)".into())
}

/// Why the page is empty.
pub(crate) fn empty_lines(table: Option<&ShopJobTable>) -> Vec<String> {
    match table {
        Some(table) if !table.error.is_empty() => vec![table.error.clone()],
        Some(table) => vec![
            format!("machine {} has no jobs.", table.machine),
            "`retrace shop submit FILE` submits one, `retrace shop agent` takes and checks it.".into(),
        ],
        None => vec!["Jobs of a shop are not built into this command.".into()],
    }
}

/// Widths of the columns of the list, as many characters as a row may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ShopJobColumns {
    program: usize,
    /// 0 where no job has an order number.
    order: usize,
    submitter: usize,
    material: usize,
    note: usize,
}

/// Columns before the texts: mark, order, state, pieces and check, with their blanks.
const FIXED: usize = 2 + 4 + 12 + 8 + 11;

impl ShopJobColumns {
    /// Columns of a list of this width for these jobs.
    pub(crate) fn of(width: usize, rows: &[ShopJobRow]) -> Self {
        let rest = width.saturating_sub(FIXED + 3).max(20);
        let has_orders = rows.iter().any(|row| !row.order_number.is_empty());
        let order = if has_orders { (rest / 6).clamp(6, 14) } else { 0 };
        let program = (rest / 3).clamp(10, 32);
        let submitter = (rest / 6).clamp(5, 12);
        let material = (rest / 5).clamp(5, 20);
        let before = program + submitter + material + if has_orders { order + 1 } else { 0 };
        Self { program, order, submitter, material, note: rest.saturating_sub(before).min(40) }
    }

    /// Heading of the columns.
    pub(crate) fn heading(self) -> String {
        self.line(["  ", "", "state", "program", "pieces", "check", "order", "from", "material", "note"])
    }

    /// Line of a job.
    pub(crate) fn row(self, place: usize, row: &ShopJobRow, is_marked: bool) -> String {
        let (place, pieces) = (place.to_string(), format!("{}/{}", row.good, row.quantity));
        let mark = if is_marked { "> " } else { "  " };
        self.line([
            mark,
            &place,
            row.state,
            &row.program,
            &pieces,
            &row.check,
            &row.order_number,
            &row.submitter,
            &row.material,
            &row.note,
        ])
    }

    fn line(self, cells: [&str; 10]) -> String {
        let [mark, place, state, program, pieces, check, order, from, material, note] = cells;
        let Self { program: p, order: o, submitter: s, material: m, note: n } = self;
        let [program, from, material, note] =
            [(program, p), (from, s), (material, m), (note, n)].map(|(text, width)| shortened(text, width));
        let (pieces, check) = (shortened(pieces, 7), shortened(check, 10));
        let order = if o > 0 { format!(" {:<o$}", shortened(order, o)) } else { String::new() };
        format!(
            "{mark}{place:>3} {state:<11} {program:<p$} {pieces:<7} {check:<10}{order} {from:<s$} {material:<m$} {note}"
        )
        .trim_end()
        .to_owned()
    }
}

/// Cuts a text to `width` characters; an ellipsis marks the cut.
fn shortened(text: &str, width: usize) -> String {
    let mut characters = text.chars();
    let mut cut: String = characters.by_ref().take(width).collect();
    if characters.next().is_some() {
        cut.pop();
        cut.push('…');
    }
    cut
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::program_facts::ProgramFacts;
    use retrace_config::MachineConfig;
    use std::sync::Arc;

    /// A job as the list shows it.
    pub(crate) fn row(number: usize, state: &'static str) -> ShopJobRow {
        ShopJobRow {
            id: format!("01a22509-1fde-7f8d-b56a-{number:012}"),
            state,
            is_ready: state == "ready",
            program: format!("bracket-{number}.ngc"),
            good: 1,
            quantity: 3,
            most_pieces: 1,
            check: if state == "refused" { "2 errors".into() } else { "no errors".into() },
            submitter: "ann".into(),
            order_number: String::new(),
            note: format!("for order {number}"),
            material: "steel 4 mm".into(),
            warnings: Vec::new(),
            details: vec![("submitted".into(), "2026-11-22T00:46:27.123Z by ann".into())],
        }
    }

    pub(crate) fn table(rows: Vec<ShopJobRow>) -> ShopJobTable {
        let (machine, machine_file) = ("mill-3".into(), "mill.toml".into());
        ShopJobTable { machine, machine_file, rows, ..ShopJobTable::default() }
    }

    fn model(rows: Vec<ShopJobRow>) -> ScreenModel {
        let machine = MachineConfig::built_in().expect("valid");
        let mut model = ScreenModel::new(Arc::new(ProgramFacts::of(&machine, "part.ngc", "M2\n")));
        model.shop_jobs = Some(Arc::new(table(rows)));
        model
    }

    fn shown(model: &ScreenModel, mark: &ShopJobMark, key: Key) -> ShopJobMark {
        match choice(model, mark, key) {
            ShopJobChoice::Show(mark) => mark,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_piece_is_started_by_cycle_start_and_yes_only_and_the_mark_stays_with_its_job() {
        let mut model = model(vec![row(1, "done"), row(2, "ready"), row(3, "ready")]);
        let second = model.shop_jobs.as_ref().map(|table| table.rows[1].id.clone());
        let asked = shown(&model, &ShopJobMark::default(), Key::Char('c'));
        assert_eq!(
            asked,
            ShopJobMark { chosen: second.clone(), view: ShopJobView::Start(1) },
            "the first that is ready"
        );
        // the list changes meanwhile
        model.shop_jobs = Some(Arc::new(table(vec![row(2, "ready"), row(3, "ready")])));
        let started = second.clone().map(|id| ShopJobChoice::Start(id, 1));
        assert_eq!(Some(choice(&model, &asked, Key::Char('y'))), started);
        for key in [Key::Enter, Key::Char('n'), Key::Esc, Key::Char('C')] {
            assert_eq!(shown(&model, &asked, key).view, ShopJobView::List, "{key:?}");
        }
        assert_eq!(shown(&model, &asked, Key::Char('c')), asked, "a key that repeats itself");
        for key in [Key::Char('y'), Key::Char('q'), Key::Esc] {
            assert_eq!(choice(&model, &ShopJobMark::default(), key), ShopJobChoice::Close, "{key:?}");
        }
    }

    #[test]
    fn a_series_is_as_long_as_the_question_shows_and_never_longer_than_what_is_missing() {
        let mut model = model(vec![ShopJobRow { most_pieces: 3, ..row(1, "ready") }, row(2, "ready")]);
        let mut asked = shown(&model, &ShopJobMark::default(), Key::Char('c'));
        for (key, pieces) in
            [(Key::Down, 1), (Key::Up, 2), (Key::Char('c'), 2), (Key::Up, 3), (Key::Up, 3), (Key::Down, 2)]
        {
            asked = shown(&model, &asked, key);
            assert_eq!(asked.view, ShopJobView::Start(pieces), "{key:?}");
        }
        assert_eq!(choice(&model, &asked, Key::Char('y')), ShopJobChoice::Start(row(1, "ready").id, 2));
        // one piece was run elsewhere, or the list is that of another job
        let only = ShopJobRow { most_pieces: 1, ..row(1, "ready") };
        model.shop_jobs = Some(Arc::new(table(vec![only])));
        assert!(matches!(choice(&model, &asked, Key::Char('y')), ShopJobChoice::Refuse(_)));
        // a job that permits no series
        let asked = shown(&model, &ShopJobMark::default(), Key::Char('c'));
        assert_eq!(shown(&model, &asked, Key::Up).view, ShopJobView::List);
    }

    #[test]
    fn what_is_not_ready_and_what_would_be_no_piece_is_not_started() {
        let refused = |model: &ScreenModel, key| match choice(
            model,
            &ShopJobMark { chosen: None, view: ShopJobView::Start(1) },
            key,
        ) {
            ShopJobChoice::Refuse(why) => why,
            other => panic!("{other:?}"),
        };
        for state in ["queued", "taken", "running", "interrupted", "unknown", "done", "ended early", "refused"] {
            let model = model(vec![row(1, state)]);
            assert!(refused(&model, Key::Char('y')).contains(state));
            assert!(matches!(choice(&model, &ShopJobMark::default(), Key::Char('c')), ShopJobChoice::Refuse(_)));
        }
        let mut model = model(vec![row(1, "ready")]);
        let other = ShopJobRow { is_ready: false, warnings: vec!["made for another one".into()], ..row(1, "ready") };
        model.shop_jobs = Some(Arc::new(table(vec![other])));
        assert_eq!(refused(&model, Key::Char('y')), "made for another one");
        model.shop_jobs = Some(Arc::new(table(vec![row(1, "ready")])));
        model.dry_run = true;
        assert!(refused(&model, Key::Char('y')).contains("dry run"));
        for stage in [ScreenStage::Job, ScreenStage::Resuming] {
            model.stage = stage;
            assert!(refused(&model, Key::Char('y')).contains("running"));
            assert!(!applies(&model, &ShopJobMark { chosen: None, view: ShopJobView::Start(1) }));
        }
    }

    #[test]
    fn the_mark_moves_and_the_details_scroll() {
        let model = model((1..=30).map(|number| row(number, "ready")).collect());
        let mut mark = ShopJobMark::default();
        for (key, number) in
            [(Key::Up, 1), (Key::Down, 2), (Key::PageDown, 12), (Key::PageDown, 22), (Key::PageDown, 30), (Key::Up, 29)]
        {
            mark = shown(&model, &mark, key);
            assert_eq!(mark.chosen, Some(row(number, "ready").id), "{key:?}");
        }
        mark = shown(&model, &mark, Key::Enter);
        assert_eq!(shown(&model, &mark, Key::Up), mark);
        mark = shown(&model, &mark, Key::PageDown);
        assert_eq!(mark.view, ShopJobView::Details(10));
        assert_eq!(shown(&model, &mark, Key::Esc), ShopJobMark { view: ShopJobView::List, ..mark });
    }

    #[test]
    fn a_row_fits_its_width() {
        let mut long = row(1, "interrupted");
        (long.note, long.program, long.quantity) = ("ä".repeat(200), "p".repeat(120), 100_000);
        for (width, order) in [(75, 0), (100, 0), (200, 0), (75, 100), (100, 100), (200, 100)] {
            long.order_number = "4".repeat(order);
            let columns = ShopJobColumns::of(width, std::slice::from_ref(&long));
            for line in [columns.row(999, &long, true), columns.heading()] {
                assert!(line.chars().count() <= width, "{width}: {line}");
            }
            let (heading, line) = (columns.heading(), columns.row(999, &long, true));
            assert_eq!((heading.contains("order"), line.contains("4444")), (order > 0, order > 0), "{line}");
        }
    }
}
