// A change of rows of tables that lie column by column: number `before` * c + i stands in column c of row i.
struct Rows {
    // How many rows there are before and after the change.
    before: u32,
    after: u32,
    // Columns of the table that is gathered, or of the values that are set.
    columns: u32,
    // Where the values that are set begin.
    first_column: u32,
    // How many rows are set.
    listed: u32,
    // 1 if rows marked as fresh become zeros.
    clears_fresh: u32,
}
