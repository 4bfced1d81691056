// Prints the errors that Apache PDFBox Preflight finds in a PDF file, one line for each: code and message. Preflight checks for PDF/A-1b.

import java.io.File;
import org.apache.pdfbox.preflight.PreflightDocument;
import org.apache.pdfbox.preflight.ValidationResult;
import org.apache.pdfbox.preflight.exception.SyntaxValidationException;
import org.apache.pdfbox.preflight.parser.PreflightParser;

public class Preflight {
    public static void main(String[] files) throws Exception {
        PreflightParser parser = new PreflightParser(new File(files[0]));
        ValidationResult found;
        try {
            parser.parse();
            try (PreflightDocument document = parser.getPreflightDocument()) {
                document.validate();
                found = document.getResult();
            }
        } catch (SyntaxValidationException error) {
            found = error.getResult();
        }
        for (ValidationResult.ValidationError error : found.getErrorsList()) {
            System.out.println(error.getErrorCode() + " " + error.getDetails());
        }
    }
}
